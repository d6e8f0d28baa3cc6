"""What of a run may be relied on: its path, and its signs on that path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pipeline.shared.values import listing, mapping

KEYS = {"path": "verdict", "signs": "signs_verdict"}
"""Where run.json and the markers of a fleet have what is said of each."""


@dataclass(frozen=True)
class Told:
    """Whether the path or the signs (``of``) are good, doubtful or unusable, and why."""

    of: str
    state: str
    reasons: tuple[str, ...] = ()

    def sentence(self) -> str:
        """In one line, the first reason with it."""
        more = f" (and {len(self.reasons) - 1} more)" if len(self.reasons) > 1 else ""
        why = f": {self.reasons[0]}{more}" if self.reasons else ""
        return f"the {self.of} {'is' if self.of == 'path' else 'are'} {self.state}{why}"


def verdicts(record: Mapping[str, Any]) -> dict[str, Told]:
    """What ``record`` says of the path and of the signs, without what it says nothing of."""
    told = {}
    for of, key in KEYS.items():
        verdict = mapping(record.get(key))
        if verdict.get("state"):
            texts = (str(mapping(r).get("text", "")) for r in listing(verdict.get("reasons")))
            told[of] = Told(of, str(verdict["state"]), tuple(texts))
    return told


def doubted(record: Mapping[str, Any]) -> list[Told]:
    """The verdicts of ``record`` that are not good."""
    return [told for told in verdicts(record).values() if told.state != "good"]
