"""Troubles that come and go: told when they begin and when they are over."""

from __future__ import annotations

from automap.recording.reader import Event


class Conditions:
    """Keeps which troubles are on, and tells the changes."""

    def __init__(self, event: Event) -> None:
        self._event = event
        self.active: dict[str, str] = {}

    def update(self, now: dict[str, str], told: frozenset[str] = frozenset()) -> None:
        """Take the troubles of this moment: name -> sentence; those ``told`` already by
        whoever met them are only kept."""
        for name, text in now.items():
            if name not in self.active and name not in told:
                self._event("warning", text)
        for name in self.active:
            if name not in now and name not in told:
                self._event("note", f"over: {self.active[name]}")
        # the sentence of the beginning stays, its figures with it
        self.active = {name: self.active.get(name, text) for name, text in now.items()}
