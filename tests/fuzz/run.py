"""Damaged files through every reader, until the count or the time is up.

    python -m tests.fuzz.run [--count N] [--seconds S] [--seed N] [--only GLOB] [-o FOLDER]

Begins with a whole file for each harness and with what once went wrong (``found``); a file whose
sentence is new is kept and damaged further. A harness runs in batches, each in a process of its
own, so that one that dies or hangs is told of and the run goes on; next is who has had the least of
the processor. What no reader may do - an exception that is not ours, a warning of a library, a
sentence of a page, ten seconds - is written to FOLDER, and the table by kind as it grows
(``table.md``). The exit code is 1 where something was found. A harness's n-th file is the same in
every run of one seed.
"""

from __future__ import annotations

import argparse
import mmap
import os
import random
import re
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path

from tests.fuzz.attempt import HUNG_S, Outcome, attempt
from tests.fuzz.batches import in_process
from tests.fuzz.more_seeds import more_seeds
from tests.fuzz.mutations import damaged
from tests.fuzz.seeds import seeds as plain_seeds


def seeds() -> dict[str, bytes]:
    """A whole file for each harness."""
    return plain_seeds() | more_seeds()


FOUND = Path(__file__).with_name("found")


def found_files() -> list[tuple[str, Path]]:
    """Files that once went wrong, each with its harness, by the beginning of its name."""
    names = sorted(seeds(), key=len, reverse=True)
    return [
        (next(name for name in names if path.name.startswith(f"{name}_")), path)
        for path in sorted(FOUND.glob("*.bin"))
    ]


_KEPT = 200  # files of one harness to go on from; the oldest make room
_BATCH_S = 4.0  # of the processor
_BATCHES = 10  # of a harness at least, where the count is small
_TURNS = 10  # every tenth batch goes by turns, so that slow readers have files too


@dataclass
class Harness:
    """What is known of one: ``pool`` begins with the whole file; ``wrong`` by place. ``number`` is
    that of the next file; ``count`` were read and told of."""

    name: str
    pool: list[bytes]
    table: Counter[str] = field(default_factory=Counter)
    said: set[str] = field(default_factory=set)
    wrong: dict[str, tuple[bytes, Outcome]] = field(default_factory=dict)
    count: int = 0
    number: int = 0
    worked_s: float = 0.0

    def add(self, data: bytes, outcome: Outcome) -> None:
        """What came of the next file."""
        self.count += 1
        self.table[outcome.kind] += 1
        # the same sentence about another line is nothing new
        shape = outcome.kind + re.sub(r"[\d'\"].*", "", outcome.said)
        if shape not in self.said:
            self.said.add(shape)
            self.pool[1:] = [*self.pool[1:], data][-_KEPT:]
        if not outcome.good:
            self.wrong.setdefault(" ".join(outcome.said.split()[:2]), (data, outcome))


def harnesses(only: str = "*") -> list[Harness]:
    """All whose names match, before their first file."""
    known = {name: Harness(name, [data]) for name, data in seeds().items() if fnmatch(name, only)}
    for name, path in found_files():
        if name in known:
            known[name].pool.append(path.read_bytes())
    return list(known.values())


def fuzz(
    harness: Harness,
    count: int,
    seconds: float,
    seed: int,
    begins: Callable[[int], None] = lambda number: None,
) -> None:
    """The next ``count`` files of a harness, fewer where the processor time is up; ``begins`` is
    told the number of each before it is read."""
    start = time.process_time()
    for done in range(count):
        # one at least: making the whole files may take as long
        if done and time.process_time() - start > seconds:
            break
        begins(harness.number)
        draw = random.Random(f"{seed} {harness.name} {harness.number}")
        harness.number += 1
        # half of all from the whole file: of one that is refused most is refused in the same way
        pool = harness.pool[: 1 if draw.random() < 0.5 else None]
        data = damaged(draw.choice(pool), draw)
        harness.add(data, attempt(harness.name, data))
    harness.worked_s += time.process_time() - start


def _batch(harness: Harness, count: int, seed: int, root: Path) -> Harness:
    """The harness after its next files, or after the one that ended the process; of those before
    that one in its batch nothing is known."""
    at = mmap.mmap(-1, 8)  # both processes have it

    def begins(number: int) -> None:
        at[:] = number.to_bytes(8, "little")

    def work() -> Harness:
        fuzz(harness, count, _BATCH_S, seed, begins)
        return harness

    with tempfile.TemporaryDirectory(dir=root) as folder:
        ended = in_process(work, Path(folder), 2.0 * HUNG_S)
        if isinstance(ended, Harness):
            return ended
        last = next((p for p in Path(folder).glob(f"*/{harness.name}.*")), None)
        data = last.read_bytes() if last is not None else b""
        harness.number = int.from_bytes(at[:], "little") + 1
        harness.add(data, Outcome("died", ended))
        harness.worked_s += _BATCH_S
        return harness


def _next(running: list[Harness], batches: int) -> int:
    if batches % _TURNS == 0:
        return batches // _TURNS % len(running)
    return min(range(len(running)), key=lambda k: (running[k].worked_s, running[k].count))


def table_of(running: list[Harness]) -> str:
    """Outcomes by harness and kind, in Markdown."""
    kinds = sorted({kind for harness in running for kind in harness.table})
    rows = [[h.name, *(str(h.table[kind]) for kind in kinds), str(h.count)] for h in running]
    sums = [str(sum(h.table[kind] for h in running)) for kind in kinds]
    rows = [["reader", *kinds, "all"], ["---"] * (len(kinds) + 2), *rows]
    rows.append(["all", *sums, str(sum(h.count for h in running))])
    return "".join("| " + " | ".join(row) + " |\n" for row in rows)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="*")
    parser.add_argument("-o", "--out", type=Path, default=Path("build/fuzz"))
    args = parser.parse_args()
    if "TMPDIR" not in os.environ and os.access("/dev/shm", os.W_OK):
        tempfile.tempdir = "/dev/shm"  # in memory: a disk takes longer than most readers
    # else GDAL writes 75 MB for its nodes of any file of OpenStreetMap
    os.environ.setdefault("OSM_MAX_TMPFILE_SIZE", "1")
    args.out.mkdir(parents=True, exist_ok=True)
    start, batches, done, told = time.monotonic(), 0, 0, 0
    running = harnesses(args.only)
    most = max(10, args.count // (_BATCHES * len(running)))
    for harness in running:
        if not harness.name.startswith("request"):  # a server's threads do not come along
            attempt(harness.name, harness.pool[0])  # modules are loaded once
    with tempfile.TemporaryDirectory(prefix="fuzz") as root:
        while done < args.count and time.monotonic() - start < args.seconds:
            k = _next(running, batches)
            known = set(running[k].wrong)
            running[k] = _batch(running[k], min(most, args.count - done), args.seed, Path(root))
            for place, (data, outcome) in running[k].wrong.items():
                if place not in known:
                    name = f"{running[k].name}_{re.sub(r'[^A-Za-z0-9]+', '_', place)}.bin"
                    (args.out / name).write_bytes(data)
                    print(f"{running[k].name}: {outcome.kind}: {outcome.said}", flush=True)
            batches, done = batches + 1, sum(harness.count for harness in running)
            (args.out / "table.md").write_text(table_of(running))
            if done >= told + args.count // 100:
                told = done
                print(f"{done} files, {time.monotonic() - start:.0f} s", flush=True)
    print(table_of(running), end="")
    return 1 if any(harness.wrong for harness in running) else 0


if __name__ == "__main__":
    sys.exit(main())
