"""Put mistakes into a copy of the code and see whether the fast tests notice.

    python -m tests.mutation.run --known
    python -m tests.mutation.run --count 200 --seed 1 -o build/mutants.jsonl

``--known`` makes the mistakes of ``tests/mutation/known.py`` and fails where one passes its tests;
``--count`` draws as many of all that ``tests/mutation/mutants.py`` finds, every one as likely, and
says what share the tests of the area kill. A mistake that hangs, or does not even import, is
noticed. The copy has its own folder of compiled code, which is put back before each mistake, so
that only what the mistake touches is compiled again.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from numba.core.caching import _CacheLocator

from tests.mutation.areas import AREAS, PROJECT, own_tests, sources_of, tests_of
from tests.mutation.known import KNOWN
from tests.mutation.mutants import Mutant, mutants_of

_LIMIT_S = 300.0
"""A mistake that lets tests run longer counts as noticed: they take a minute or two."""


class Copy:
    """A copy of the project in which mistakes are made, one at a time."""

    def __init__(self, folder: Path) -> None:
        self.root, self.cache, self.kept = folder / "code", folder / "compiled", folder / "kept"
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

    def warm(self, tests: Sequence[str]) -> None:
        """Run tests as the code is, and keep what they compile; they have to pass."""
        self._restore()
        done = self.test(tests, limit_s=10 * _LIMIT_S)
        if done[0] != "survived":
            raise SystemExit(f"the tests fail without any mistake:\n{done[1]}")
        if self.cache.exists():
            shutil.rmtree(self.kept, ignore_errors=True)
            shutil.copytree(self.cache, self.kept, copy_function=os.link)

    def _restore(self) -> None:
        """Have compiled what is kept, and nothing else."""
        shutil.rmtree(self.cache, ignore_errors=True)
        if self.kept.exists():
            # numba writes beside and renames, so that a link is never written into
            shutil.copytree(self.kept, self.cache, copy_function=os.link)

    def adopt(self, compiled: Path) -> None:
        """Begin with what is compiled of this checkout in a folder of numba's.

        Numba names the folders below it after the sources' places.
        """
        for folder in {path.parent for path in (PROJECT / "automap").rglob("*.py")}:
            of = _CacheLocator.get_suitable_cache_subpath
            place = self.root / folder.relative_to(PROJECT)
            have = compiled / of(str(folder / "x.py"))
            if have.is_dir():
                shutil.copytree(have, self.kept / of(str(place / "x.py")))

    def with_mistake(self, source: Path, text: str, tests: Sequence[str]) -> tuple[str, str]:
        """Whether tests notice that a source has another text: a state, and what noticed it."""
        self._restore()
        path = self.root / source
        right = path.read_text()
        try:
            self._write(path, text)
            return self.test(tests)
        finally:
            self._write(path, right)

    def _write(self, path: Path, text: str) -> None:
        path.write_text(text)
        # python's own compiled files go by size and time to the second
        for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
            compiled.unlink()

    def test(self, tests: Sequence[str], limit_s: float = _LIMIT_S) -> tuple[str, str]:
        """Run tests up to the first that fails."""
        command = [sys.executable, "-m", "pytest", "-x", "-q", "--no-header", "--tb=line"]
        variables = os.environ | {
            "PYTHONPATH": str(self.root),
            "NUMBA_CACHE_DIR": str(self.cache),
            "OMP_NUM_THREADS": "1",
        }
        variables.pop("AUTOMAP_SHARED_DATA", None)
        try:
            done = subprocess.run(
                [*command, "-p", "no:cacheprovider", *tests],
                cwd=self.root,
                env=variables,
                capture_output=True,
                text=True,
                timeout=limit_s,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return "killed", f"took more than {limit_s:.0f} s"
        if done.returncode == 0:
            return "survived", ""
        if done.returncode > 2:
            raise SystemExit(f"no tests ran: {' '.join(command)} {' '.join(tests)}\n{done.stdout}")
        told = [s for s in done.stdout.splitlines() if s.startswith(("FAILED", "ERROR"))]
        return "killed", told[0] if told else (done.stdout + done.stderr)[-300:]


def _known(copy: Copy) -> int:
    passed = []
    copy.warm(sorted({f"tests/unit/{name}" for mistake in KNOWN for name in mistake.tests}))
    for mistake in KNOWN:
        right = (copy.root / mistake.source).read_text()
        if mistake.old not in right:
            passed.append(f"{mistake.name}: {mistake.source} has no {mistake.old!r}")
            continue
        tests = [f"tests/unit/{name}" for name in mistake.tests]
        wrong = right.replace(mistake.old, mistake.new)
        state, by = copy.with_mistake(Path(mistake.source), wrong, tests)
        print(f"{state:9} {mistake.name}: {by[:120]}", flush=True)
        if state != "killed":
            passed.append(f"{mistake.name}: passes {', '.join(mistake.tests)}")
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
    return random.Random(seed).sample(every, min(count, len(every)))


@dataclass(frozen=True)
class Sample:
    """How many mistakes of which areas, by which seed; every ``of``-th of them from ``part`` on."""

    areas: Sequence[str]
    count: int
    seed: int
    part: int
    of: int
    hours: float


def _sampled(copy: Copy, sample: Sample, out: Path) -> int:
    chosen = drawn(copy.root, sample.areas, sample.count, sample.seed)[sample.part :: sample.of]
    ends = time.monotonic() + 3600.0 * sample.hours
    counts: Counter[tuple[str, str]] = Counter()
    warmed: set[str] = set()
    out.parent.mkdir(parents=True, exist_ok=True)
    with out.open("w", encoding="utf-8") as stream:
        for area, source, mutant in chosen:
            if time.monotonic() > ends:
                break
            tests = tests_of(area, source, copy.root)
            if area not in warmed:
                warmed.add(area)
                copy.warm(own_tests(area, copy.root))
            begun = time.monotonic()
            text = mutant.applied((copy.root / source).read_text())
            state, by = copy.with_mistake(source, text, tests)
            counts[area, state] += 1
            row = {
                "area": area,
                "place": f"{source}:{mutant.line}",
                "what": mutant.what,
                "state": state,
                "by": by,
                "seconds": round(time.monotonic() - begun, 1),
            }
            stream.write(json.dumps(row) + "\n")
            stream.flush()
            print(f"{state:9} {row['place']} {mutant.what}", flush=True)
    print(table(counts))
    return 0


def table(counts: Counter[tuple[str, str]]) -> str:
    """Mistakes made and noticed by area, as the documentation has them."""
    rows = ["| area | mistakes | noticed |", "|---|---|---|"]
    total = Counter(state for (_, state), n in counts.items() for _ in range(n))
    for area in dict.fromkeys(area for area, _ in counts):
        killed, survived = counts[area, "killed"], counts[area, "survived"]
        rows.append(f"| {area} | {killed + survived} | {killed} |")
    rows.append(f"| all | {sum(total.values())} | {total['killed']} |")
    return "\n".join(rows)


def main() -> int:
    """Read the command line and do it."""
    parser = argparse.ArgumentParser(description="Mistakes that the fast tests should notice.")
    parser.add_argument("--known", action="store_true", help="make those of known.py")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--area", action="append", choices=list(AREAS))
    parser.add_argument("--part", default="0/1", help="I/N: every N-th of them, from I on")
    parser.add_argument(
        "--compiled", type=Path, help="NUMBA_CACHE_DIR of this checkout's, to begin"
    )
    parser.add_argument("--hours", type=float, default=8.0, help="draw no more after so long")
    parser.add_argument("-o", "--out", type=Path, default=PROJECT / "build" / "mutants.jsonl")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        copy = Copy(Path(folder))
        if options.compiled is not None:
            copy.adopt(options.compiled)
        if options.known:
            return _known(copy)
        part, of = map(int, options.part.split("/"))
        areas = options.area or list(AREAS)
        sample = Sample(areas, options.count, options.seed, part, of, options.hours)
        return _sampled(copy, sample, options.out)


if __name__ == "__main__":
    sys.exit(main())
