"""Put mistakes into a copy of the code and see whether the fast tests notice.

    python -m tests.mutation.run --known
    python -m tests.mutation.run --count 200 --seed 1 -o build/mutants.jsonl

``--known`` makes the mistakes of ``tests/mutation/known.py`` and fails where one passes its tests;
``--count`` draws as many of all that ``tests/mutation/mutants.py`` finds, every one as likely, and
says what share is noticed. Asked are the unit tests of the areas that call what the mistake is in,
the quickest first, up to the first that fails and for ``--seconds`` at most; so the share is rather
too small. A mistake that hangs, or does not even import, is noticed. Which test calls what is
recorded before and kept in ``build/mutation``.
"""

from __future__ import annotations

import argparse
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

from tests.mutation.areas import AREAS, PROJECT, own_tests, sources_of
from tests.mutation.asked import COMPILED, Calls, functions_of
from tests.mutation.known import KNOWN
from tests.mutation.mutants import Mutant, mutants_of, parses
from tests.mutation.worker import write


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
        for name in filter(None, listed.stdout.split("\0")):
            if (PROJECT / name).is_file():
                (self.root / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(PROJECT / name, self.root / name)
        kept.mkdir(parents=True, exist_ok=True)
        self.calls = Calls(kept / "calls.json")
        self._sound: dict[tuple[str, ...], bool] = {}
        self.variables = {
            "PYTHONPATH": str(self.root),
            "NUMBA_DISABLE_JIT": "1",
            "OMP_NUM_THREADS": "1",
            # no recordings
            "AUTOMAP_SHARED_DATA": str(folder / "none"),
        }

    def record(self, files: Sequence[str]) -> None:
        """Have the calls of all of some test files."""
        self.calls.record(files, self.root, self.variables)

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

    def compiled(self, mistake: Mistake) -> tuple[str, str]:
        """The same of one mistake by whole test files with compiled kernels: minutes."""
        if not self._pass(mistake.only):
            return "unclear", "the tests fail without the mistake too"
        path = self.root / mistake.source
        right = path.read_text()
        try:
            write(path, mistake.text)
            code, told = self._tested(mistake.only)
        finally:
            write(path, right)
        return ("survived", "") if code == 0 else ("killed", told)

    def _pass(self, files: tuple[str, ...]) -> bool:
        """Whether test files pass without a mistake; after it all their kernels are compiled."""
        if files not in self._sound:
            self._sound[files] = self._tested(files)[0] == 0
        return self._sound[files]

    def _tested(self, files: tuple[str, ...]) -> tuple[int, str]:
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *files],
            cwd=self.root,
            env=os.environ | self.variables | {"NUMBA_DISABLE_JIT": "0"},
            capture_output=True,
            text=True,
            check=False,
        )
        told = [s for s in done.stdout.splitlines() if s.startswith(("FAILED", "ERROR"))]
        return done.returncode, (told or [""])[0]

    def _ask(self, mistake: Mistake, to: IO[str], answers: IO[str]) -> tuple[str, str]:
        names = functions_of(mistake.source, mistake.line)
        # where kernels import what is changed every one would be compiled anew
        no_kernel = mistake.source.parts[0] == "pipeline"
        tests = self.calls.tests_of(names, self.seconds, mistake.only, no_kernel)
        if not tests:
            return "survived", "no test calls it"
        dear = tuple(sorted({t.test.split("::")[0] for t in tests} & set(COMPILED)))
        if dear and not self._pass(dear):
            return "unclear", f"{', '.join(dear)} fails without the mistake too"
        shared = sum({name: s for t in tests for name, s in t.shared}.values())
        job = {
            "source": str(mistake.source),
            "text": mistake.text,
            "tests": [t.test for t in tests],
            "compiled": bool(dear),
            # what takes so much longer does not end
            "limit_s": round(30.0 + 5.0 * sum(t.seconds for t in tests) + 5.0 * shared),
        }
        to.write(json.dumps(job) + "\n")
        to.flush()
        state, by = json.loads(answers.readline())
        return state, by or f"{len(tests)} tests"


def _known(copy: Copy) -> int:
    files = sorted({f"tests/unit/{name}" for known in KNOWN for name in known.tests})
    copy.record(files)
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
        if state != "killed":
            state, by = copy.compiled(mistake)
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
    copy.record(sorted({t for area in areas for t in own_tests(area)}))
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
            print(f"{state:9} {place} {mistake.what}", flush=True)
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
