"""Which tests are asked of a mistake: those that may come to it, the nearest and quickest first."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

QUICK_S = 1.0
"""Tests that took longer are asked last."""

MOST_S = 10.0
"""Tests that took longer are not asked."""

MOST = 120
"""Tests that are asked of a mistake."""


INTERPRETED = " interpreted"
"""Behind the name of a test whose seconds are those with a part of the kernels interpreted."""


class Seconds:
    """What tests take, learnt as they are asked and kept in a file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.of: dict[str, float] = json.loads(path.read_text()) if path.exists() else {}

    def learn(self, taken: Mapping[str, float]) -> None:
        """Keep those of tests that were not known."""
        new = {test: seconds for test, seconds in taken.items() if test not in self.of}
        if new:
            self.of |= new
            self.path.write_text(json.dumps(self.of, indent=0))


def asked(
    near: Mapping[str, int],
    seconds: Mapping[str, float],
    only: Sequence[str] = (),
    interpreted: bool = False,
) -> list[tuple[str, float]]:
    """Of tests and their distances from a mistake those that are asked, with their seconds."""

    def took(test: str) -> float:
        known = seconds.get(test, 0.0)
        return seconds.get(test + INTERPRETED, known) if interpreted else known

    def order(test: str) -> tuple[bool, int, float]:
        return took(test) > QUICK_S, near[test], took(test)

    found = (t for t in near if not only or t.split("::")[0] in only)
    found = sorted((t for t in found if took(t) <= MOST_S), key=order)
    return [(test, seconds.get(test, 0.0)) for test in found[:MOST]]
