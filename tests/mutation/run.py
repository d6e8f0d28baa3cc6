"""Put mistakes into a copy of the code and see whether the fast tests notice.

    python -m tests.mutation.run --known
    python -m tests.mutation.run --count 200 --seed 1 -o build/mutants.jsonl

``--known`` makes the mistakes of ``tests/mutation/known.py`` and fails where one passes its tests;
``--count`` draws as many of all that ``tests/mutation/mutants.py`` finds, every one as likely, and
says what share is noticed. Asked are the fast unit tests that call what the mistake is in, up to
the first that fails and for ``--seconds`` of the processor at most; so the share is rather too
small. A mistake that does not even import is noticed, and one with which a test takes eight seconds
and three times what it takes without. What tests take is kept in ``build/mutation``.
"""

from __future__ import annotations

import argparse
import filecmp
import itertools
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from tests.mutation.areas import AREAS, PROJECT, sources_of
from tests.mutation.asked import Seconds, asked
from tests.mutation.graph import functions_of, kernels_from, reaching
from tests.mutation.known import KNOWN
from tests.mutation.mutants import Mutant, mutants_of, parses


@dataclass(frozen=True)
class Mistake:
    """A source with another text; ``only`` these test files are asked, or all."""

    area: str
    source: Path
    line: int
    what: str
    text: str
    only: tuple[str, ...] = ()


class Copy:
    """A copy of the project in which mistakes are made, and what its tests call."""

    def __init__(self, folder: Path, kept: Path, seconds: float) -> None:
        self.root, self.seconds = folder / "code", seconds
        listed = subprocess.run(
            ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
            cwd=PROJECT,
            capture_output=True,
            text=True,
            check=True,
        )
        names = list(filter(None, listed.stdout.split("\0")))
        if not self.root.exists():  # with what is compiled already
            compiled = PROJECT.rglob("__pycache__/*.nb[ic]")
            names += [str(path.relative_to(PROJECT)) for path in compiled]
        for name in names:
            right, there = PROJECT / name, self.root / name
            if right.is_file() and not (there.exists() and filecmp.cmp(right, there, False)):
                there.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(right, there)
        kept.mkdir(parents=True, exist_ok=True)
        self.taken = Seconds(kept / "seconds.json")
        self.variables = {
            "PYTHONPATH": str(self.root),
            "OMP_NUM_THREADS": "1",
            # no recordings
            "AUTOMAP_SHARED_DATA": str(folder / "none"),
        }

    def ask(self, mistakes: Sequence[Mistake]) -> Iterable[tuple[Mistake, str, str]]:
        """Of each mistake the state, killed or survived, and what noticed it."""
        command = [sys.executable, "-m", "tests.mutation.worker", str(self.root)]
        with subprocess.Popen(
            command,
            cwd=self.root,
            env=os.environ | self.variables,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        ) as worker:
            assert worker.stdin is not None
            assert worker.stdout is not None
            for mistake in mistakes:
                yield mistake, *self._ask(mistake, worker.stdin, worker.stdout)
            worker.stdin.close()

    def _ask(self, mistake: Mistake, to: IO[str], answers: IO[str]) -> tuple[str, str]:
        changed = functions_of(mistake.source, mistake.line)
        plain = kernels_from(changed)
        tests = asked(reaching(changed), self.taken.of, mistake.only, bool(plain))
        if not tests:
            return "survived", "no test comes to it"
        job = {
            "source": str(mistake.source),
            "text": mistake.text,
            "plain": sorted(plain),
            "tests": tests,
            "seconds": self.seconds,
        }
        to.write(json.dumps(job) + "\n")
        to.flush()
        state, by, taken = json.loads(answers.readline())
        self.taken.learn(taken)
        return state, by


def _known(copy: Copy) -> int:
    mistakes, passed = [], []
    for known in KNOWN:
        right = (PROJECT / known.source).read_text()
        if known.old not in right:
            passed.append(f"{known.name}: {known.source} has no {known.old!r}")
            continue
        line = right[: right.index(known.old.strip())].count("\n") + 1
        only = tuple(f"tests/unit/{name}" for name in known.tests)
        text = right.replace(known.old, known.new)
        mistakes.append(Mistake("known", Path(known.source), line, known.name, text, only))
    for mistake, state, by in copy.ask(mistakes):
        print(f"{state:9} {mistake.what}: {by[:120]}", flush=True)
        if state != "killed":
            passed.append(f"{mistake.what}: passes {', '.join(mistake.only)}")
    for text in passed:
        print(f"not noticed: {text}")
    return 1 if passed else 0


def drawn(
    root: Path, areas: Iterable[str], count: int, seed: int
) -> list[tuple[str, Path, Mutant]]:
    """Mistakes at random out of all of some areas."""
    every = [
        (area, source, mutant)
        for area in areas
        for source in sources_of(area, root)
        for mutant in mutants_of((root / source).read_text())
    ]
    random.Random(seed).shuffle(every)
    texts = {source: (root / source).read_text() for _, source, _ in every}
    parsed = (each for each in every if parses(each[2].applied(texts[each[1]])))
    return list(itertools.islice(parsed, count))


def _sampled(copy: Copy, areas: Sequence[str], count: int, seed: int, out: Path) -> int:
    mistakes = [
        Mistake(area, source, m.line, m.what, m.applied((PROJECT / source).read_text()))
        for area, source, m in drawn(PROJECT, areas, count, seed)
    ]
    counts: Counter[tuple[str, str]] = Counter()
    out.parent.mkdir(parents=True, exist_ok=True)
    with out.open("w", encoding="utf-8") as stream:
        for mistake, state, by in copy.ask(mistakes):
            counts[mistake.area, state] += 1
            place = f"{mistake.source}:{mistake.line}"
            row = {"area": mistake.area, "place": place, "what": mistake.what}
            stream.write(json.dumps(row | {"state": state, "by": by}) + "\n")
            stream.flush()
            print(f"{state:9} {place} {mistake.what} | {by}", flush=True)
    print(table(counts))
    return 0


def table(counts: Counter[tuple[str, str]]) -> str:
    """Mistakes made and noticed by area, as the documentation has them."""
    rows = ["| area | mistakes | noticed |", "|---|---|---|"]
    for area in [*AREAS, "all"]:
        states = [
            state for (of, state), n in counts.items() for _ in range(n) if area in (of, "all")
        ]
        if states:
            rows.append(f"| {area} | {len(states)} | {states.count('killed')} |")
    return "\n".join(rows)


def main() -> int:
    """Read the command line and do it."""
    parser = argparse.ArgumentParser(description="Mistakes that the fast tests should notice.")
    parser.add_argument("--known", action="store_true", help="make those of known.py")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--area", action="append", choices=list(AREAS))
    parser.add_argument("--seconds", type=float, default=25.0, help="of tests for a mistake")
    parser.add_argument("--folder", type=Path, help="for the copy; a temporary one by default")
    parser.add_argument("-o", "--out", type=Path, default=PROJECT / "build" / "mutants.jsonl")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = (options.folder or Path(temporary)).resolve()
        copy = Copy(folder, PROJECT / "build" / "mutation", options.seconds)
        if options.known:
            return _known(copy)
        areas = options.area or list(AREAS)
        return _sampled(copy, areas, options.count, options.seed, options.out)


if __name__ == "__main__":
    sys.exit(main())
