"""Which tests are asked of a mistake: those that call what it is in, quick ones of its area first.

What each test calls is recorded once with kernels compiled, which no trace sees; which kernel is
called by what is read in the sources (``graph.py``).
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.mutation.areas import imported

QUICK_S = 1.0
"""Tests that take longer are asked last."""

MOST_S = 10.0
"""Tests that take longer, with what they share, are not asked."""


@dataclass(frozen=True)
class Asked:
    """A test, and what it takes as the code is."""

    test: str
    seconds: float
    shared: tuple[tuple[str, float], ...] = ()
    """what it shares with others, and the seconds of that"""

    @property
    def whole(self) -> float:
        """Seconds, if nothing that it shares is there yet."""
        return self.seconds + sum(seconds for _, seconds in self.shared)


class Calls:
    """What each test calls, kept in a file of which the last line of a test file counts."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.of: dict[str, dict[str, Any]] = {}
        self._read()

    def _read(self) -> None:
        for line in self.path.read_text().splitlines() if self.path.exists() else ():
            of = json.loads(line)
            self.of[of["file"]] = of

    def record(self, files: Sequence[str], root: Path, variables: dict[str, str]) -> None:
        """Run those of some test files that are new or edited, and keep what they call."""
        digests = {f: hashlib.sha256((root / f).read_bytes()).hexdigest() for f in files}
        new = [f for f in files if self.of.get(f, {}).get("digest") != digests[f]]
        if not new:
            return
        told = self.path.with_suffix(".told")
        told.unlink(missing_ok=True)
        command = [sys.executable, "-m", "pytest", "-q", "-p", "tests.mutation.calls"]
        command += ["-p", "no:cacheprovider", "-p", "no:xdist", *new]
        print(f"recording what the tests of {len(new)} files call", file=sys.stderr, flush=True)
        env = os.environ | variables | {"AUTOMAP_CALLS": str(told)}
        subprocess.run(command, cwd=root, env=env, stdout=subprocess.DEVNULL, check=False)
        written = told.read_text().splitlines() if told.exists() else []
        found = {of["file"]: of for of in map(json.loads, written)}
        with self.path.open("a") as stream:
            for name in new:  # of a file without a line no test passed
                of = {"file": name, "digest": digests[name], "tests": {}} | found.get(name, {})
                stream.write(json.dumps(of) + "\n")
        self._read()

    def tests_of(
        self, names: set[str], source: Path, root: Path, seconds: float, only: Sequence[str] = ()
    ) -> list[Asked]:
        """The tests that call one of some functions, as many as ``seconds`` allow.

        First the quick ones, of them those whose file imports ``source``, which the mistake is in.
        """
        found = [
            (test.whole > QUICK_S, source not in imported(root, Path(file)), test)
            for file, of in self.of.items()
            if not only or file in only
            for test in (_asked(name, told) for name, told in of["tests"].items())
            if not names.isdisjoint(of["tests"][test.test]["calls"])
        ]
        chosen: list[Asked] = []
        there: dict[str, float] = {}
        spent = 0.0
        for _, _, each in sorted(found, key=_order):
            more = there | dict(each.shared)
            if each.whole <= MOST_S and sum(more.values()) + spent + each.seconds <= seconds:
                there = more
                spent += each.seconds
                chosen.append(each)
        return chosen


def _asked(name: str, told: dict[str, Any]) -> Asked:
    return Asked(name, told["seconds"], tuple(sorted(told["shared"].items())))


def _order(found: tuple[bool, bool, Asked]) -> tuple[Any, ...]:
    # those that share what is dear beside each other
    slow, foreign, test = found
    dear = max((seconds for _, seconds in test.shared), default=0.0) if slow else 0.0
    return slow, foreign, dear, test.test.split("::")[0] if slow else "", test.seconds
