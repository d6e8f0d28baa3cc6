"""Damaged files through every reader, until the count or the time is up.

    python -m tests.fuzz.run [--count N] [--seconds S] [--seed N] [--only GLOB] [-o FOLDER]

Begins with a whole file for each harness and with what once went wrong (``found``); a file whose
sentence is new is kept and damaged further. What no reader may do - an exception that
is not ours, a warning of a library, a sentence of a page, ten seconds - is written to FOLDER.
Prints a table by kind; the exit code is 1 where something was found.
"""

from __future__ import annotations

import argparse
import random
import re
import sys
import time
from collections import Counter
from fnmatch import fnmatch
from pathlib import Path

from tests.fuzz.attempt import attempt
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


def fuzz(
    names: list[str], count: int, seconds: float, seed: int, found: Path | None = None
) -> tuple[Counter[tuple[str, str]], dict[tuple[str, str], bytes]]:
    """Outcomes by harness and kind, and the files that went wrong by harness and place."""
    draw, start = random.Random(seed), time.monotonic()
    pools = {name: [data] for name, data in seeds().items() if name in names}
    for name, path in found_files():
        if name in names:
            pools[name].append(path.read_bytes())
    known: set[tuple[str, str]] = set()
    table: Counter[tuple[str, str]] = Counter()
    wrong: dict[tuple[str, str], bytes] = {}
    for number in range(count):
        # one at least: making the whole files may take as long on a busy machine
        if number and time.monotonic() - start > seconds:
            break
        name = names[number % len(names)]
        # half of all from the whole file: of one that is refused most is refused in the same way
        pool = pools[name][: 1 if draw.random() < 0.5 else None]
        data = damaged(draw.choice(pool), draw)
        outcome = attempt(name, data)
        table[name, outcome.kind] += 1
        # the same sentence about another line is nothing new
        shape = name, outcome.kind + re.sub(r"[\d'\"].*", "", outcome.said)
        if shape not in known:
            known.add(shape)
            pools[name] = pools[name][:1] + [*pools[name][1:], data][-_KEPT:]
        place = name, " ".join(outcome.said.split()[:2])
        if not outcome.good and place not in wrong:
            wrong[place] = data
            print(f"{name}: {outcome.kind}: {outcome.said}", flush=True)
            if found is not None:
                found.mkdir(parents=True, exist_ok=True)
                (found / f"{name}_{re.sub(r'[^A-Za-z0-9]+', '_', place[1])}.bin").write_bytes(data)
    return table, wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="*")
    parser.add_argument("-o", "--out", type=Path, default=Path("build/fuzz"))
    args = parser.parse_args()
    names = [name for name in seeds() if fnmatch(name, args.only)]
    table, wrong = fuzz(names, args.count, args.seconds, args.seed, args.out)
    kinds = sorted({kind for _, kind in table})
    print("| reader | " + " | ".join(kinds) + " |\n|" + "---|" * (len(kinds) + 1))
    for name in names:
        print(f"| {name} | " + " | ".join(str(table[name, kind]) for kind in kinds) + " |")
    print("| all | " + " | ".join(str(sum(table[n, k] for n in names)) for k in kinds) + " |")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
