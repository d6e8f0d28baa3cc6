"""Troubles that come and go: told when they begin and when they are over."""

from __future__ import annotations

from pipeline.record.reader import Event

_OVER_AFTER = 6


class Conditions:
    """Keeps which troubles are on, and tells the changes."""

    def __init__(self, event: Event) -> None:
        self._event = event
        self._absent: dict[str, int] = {}
        self.active: dict[str, str] = {}

    def update(self, now: dict[str, str], told: frozenset[str] = frozenset()) -> None:
        """Take the troubles of this moment: name -> sentence.

        Those ``told`` already by whoever met them are only kept. A trouble is over when it was
        absent a few times in a row, so that one on the brink is told once.
        """
        for name, text in now.items():
            if name not in self.active and name not in told:
                self._event("warning", text)
        kept = {}
        for name, text in self.active.items():
            absent = 0 if name in now else self._absent.get(name, 0) + 1
            self._absent[name] = absent
            if absent < _OVER_AFTER:
                kept[name] = text
            elif name not in told:
                self._event("note", f"over: {text}")
        # the sentence of the beginning stays, its figures with it
        self.active = kept | {name: text for name, text in now.items() if name not in kept}
