"""Recorded drives with one thing wrong: does the path stay within its sigmas, or is it told?

    python tests/benchmarks/fault_table.py [-o FOLDER] [--drive GLOB] [--fault GLOB] [--axes GLOB]
        [--jobs N] [--list] [--again] [--any-version] [--keep] [--docs]

Every fault of ``tests/benchmarks/faults/catalogue.py`` is put into every drive of ``drives.py``
there, one a run, with the IMU's axes given in the manifest and with axes = "unknown", and the drive
goes through ``automap run --to fuse``. How a run is judged stands in ``judge.py`` and at the head
of the page that ``--docs`` writes. The recorded drives come from AUTOMAP_SHARED_DATA. Each finished
run is a line of FOLDER/results.jsonl with the version of the code, and a second call goes on where
the first one stopped. The table is printed and written to FOLDER/table.md; the exit code is 1 where
a run failed. All of them take an hour of one core.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from fnmatch import fnmatch
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

PROJECT = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(PROJECT))

from tests.benchmarks.faults.catalogue import FAULTS  # noqa: E402
from tests.benchmarks.faults.drives import DRIVES  # noqa: E402
from tests.benchmarks.faults.fault import Reason  # noqa: E402
from tests.benchmarks.faults.judge import AXES, Case, Errors, Row, outcome  # noqa: E402
from tests.benchmarks.faults.run import run_case, simulate  # noqa: E402
from tests.benchmarks.faults.table import Results, cells_of, details, page, summary  # noqa: E402
from tests.benchmarks.hidden_effects import ONE_THREAD, code_version  # noqa: E402

DATA = Path(os.environ.get("AUTOMAP_SHARED_DATA") or PROJECT / ".." / "shared" / "data")


def wanted(drives: str, faults: str, axes: str) -> list[Case]:
    """Cases whose names match one of the comma-separated globs each."""
    match = lambda name, globs: any(fnmatch(name, g) for g in globs.split(","))  # noqa: E731
    return [
        (d, f, a)
        for d in DRIVES
        if match(d, drives)
        for f in FAULTS
        if match(f, faults)
        for a in AXES
        if match(a, axes)
    ]


def stored(path: Path, version: str | None) -> Results:
    """The last finished runs of this version of the code, or of any."""
    done: Results = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        told = json.loads(line)
        if version in (None, told["version"]):
            row = told["row"]
            case = told["drive"], told["fault"], told["axes"]
            done[case] = told["version"], row if isinstance(row, str) else _row(row)
    return done


def _row(told: dict[str, Any]) -> Row:
    for name in ("whole", "stretch"):
        if told[name]:
            told[name] = Errors(**{**told[name], "ratio": tuple(told[name]["ratio"])})
    reasons = [Reason(r["code"], r["text"], tuple(map(tuple, r["spans"]))) for r in told["reasons"]]
    return Row(**{**told, "reasons": tuple(reasons), "span": tuple(told["span"])})


def main() -> int:
    """Run what is missing, print and write the table; 1 where a run failed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("-o", "--out", type=Path, default=PROJECT / "build" / "fault_table")
    parser.add_argument("--drive", default="*", help="globs, with commas between")
    parser.add_argument("--fault", default="*", help="globs, with commas between")
    parser.add_argument("--axes", default="*", help="given or unknown")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--list", action="store_true", help="name drives and faults, run nothing")
    parser.add_argument("--again", action="store_true", help="run finished ones too")
    parser.add_argument("--any-version", action="store_true", help="take older code's runs too")
    parser.add_argument("--keep", action="store_true", help="keep drives and paths")
    parser.add_argument("--docs", action="store_true", help="write docs/faults.md")
    args = parser.parse_args()
    cases = wanted(args.drive, args.fault, args.axes)
    if args.list:
        for name in dict.fromkeys(fault for _, fault, _ in cases):
            print(f"{name:<20} {FAULTS[name].what}")
        print("drives: " + ", ".join(dict.fromkeys(drive for drive, _, _ in cases)))
        return 0
    for name in ONE_THREAD:
        os.environ[name] = "1"
    args.out.mkdir(parents=True, exist_ok=True)
    results, version = args.out / "results.jsonl", code_version()
    done = {} if args.again else stored(results, None if args.any_version else version)
    todo = [case for case in cases if case not in done]
    print(f"{len(todo)} of {len(cases)} runs to do, code {version}", flush=True)
    for drive in {drive for drive, _, _ in todo}:
        simulate(drive, args.out / "runs")

    one = partial(run_case, DATA, work=args.out / "runs", keep=args.keep)
    # workers that stay have their imports and compiled code already
    workers = ProcessPoolExecutor(args.jobs, get_context("spawn"))
    with workers as pool, results.open("a", encoding="utf-8") as file:
        for case, row in zip(todo, pool.map(one, todo), strict=True):
            done[case] = version, row
            told = row if isinstance(row, str) else asdict(row)
            names = dict(zip(("drive", "fault", "axes"), case, strict=True))
            file.write(json.dumps({"version": version, **names, "row": told}) + "\n")
            file.flush()
            print("  ".join(case) + "  " + _brief(row), flush=True)
    shown = {case: done[case] for case in cases}
    (args.out / "table.md").write_text(details(shown), encoding="utf-8")
    if args.docs:
        (PROJECT / "docs" / "faults.md").write_text(page(shown), encoding="utf-8")
    rows = [row for _, row in shown.values() if not isinstance(row, str)]
    print()
    for row in rows:
        if outcome(row)[0] == "failed":
            print("  ".join(cells_of(row)))
    print("\n".join(summary(rows)))
    return 1 if any(outcome(row)[0] == "failed" for row in rows) else 0


def _brief(row: Row | str) -> str:
    return row if isinstance(row, str) else "  ".join([*cells_of(row)[3:], row.told[-300:]])


if __name__ == "__main__":
    sys.exit(main())
