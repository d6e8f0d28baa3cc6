"""Recorded drives with one thing wrong: does the path stay within its sigmas, or is it told?

    python tests/benchmarks/fault_table.py [-o FOLDER] [--drives GLOB] [--faults GLOB] [--jobs N]
        [--list] [--again] [--keep] [--docs]

Every fault of ``tests/benchmarks/faults/catalogue.py`` is put into every drive of ``drives.py``
there, one a run, and the drive goes through ``automap run --to fuse``. How a run is judged stands
in ``judge.py`` and at the head of the page that ``--docs`` writes. The drives come from
AUTOMAP_SHARED_DATA. Each finished run is a line of FOLDER/results.jsonl with the version of the
code, and a second call goes on where the first one stopped. The table is printed and written to
FOLDER/table.md; the exit code is 1 where a run failed.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

PROJECT = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(PROJECT))

from tests.benchmarks.faults.catalogue import FAULTS  # noqa: E402
from tests.benchmarks.faults.drives import DRIVES  # noqa: E402
from tests.benchmarks.faults.fault import Reason  # noqa: E402
from tests.benchmarks.faults.judge import Errors, Row, outcome  # noqa: E402
from tests.benchmarks.faults.run import run_case  # noqa: E402
from tests.benchmarks.faults.table import cells_of, in_order, markdown, page, summary  # noqa: E402
from tests.benchmarks.hidden_effects import ONE_THREAD, code_version  # noqa: E402

DATA = Path(os.environ.get("AUTOMAP_SHARED_DATA") or PROJECT / ".." / "shared" / "data")
Case = tuple[str, str]


def wanted(drives: str, faults: str) -> list[Case]:
    """Drives and faults whose names match one of the comma-separated globs each."""
    match = lambda name, globs: any(fnmatch(name, g) for g in globs.split(","))  # noqa: E731
    return [(d, f) for d in DRIVES if match(d, drives) for f in FAULTS if match(f, faults)]


def stored(path: Path, version: str) -> dict[Case, Row | str]:
    """Runs of this version of the code that are finished."""
    done: dict[Case, Row | str] = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        told = json.loads(line)
        if told["version"] == version:
            row = told["row"]
            done[told["drive"], told["fault"]] = row if isinstance(row, str) else _row(row)
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
    parser.add_argument("--drives", default="*", help="globs, with commas between")
    parser.add_argument("--faults", default="*", help="globs, with commas between")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--list", action="store_true", help="name drives and faults, run nothing")
    parser.add_argument("--again", action="store_true", help="run finished ones too")
    parser.add_argument("--keep", action="store_true", help="keep drives and paths")
    parser.add_argument("--docs", action="store_true", help="write docs/faults.md")
    args = parser.parse_args()
    cases = wanted(args.drives, args.faults)
    if args.list:
        for name in dict.fromkeys(fault for _, fault in cases):
            print(f"{name:<20} {FAULTS[name].what}")
        print("drives: " + ", ".join(dict.fromkeys(drive for drive, _ in cases)))
        return 0
    for name in ONE_THREAD:
        os.environ[name] = "1"
    args.out.mkdir(parents=True, exist_ok=True)
    results, version = args.out / "results.jsonl", code_version()
    done = {} if args.again else stored(results, version)
    todo = [case for case in cases if case not in done]
    print(f"{len(todo)} of {len(cases)} runs to do, code {version}", flush=True)

    def one(case: Case) -> tuple[Case, Row | str]:
        return case, run_case(DATA, *case, args.out / "runs", args.keep)

    with ThreadPoolExecutor(args.jobs) as pool, results.open("a", encoding="utf-8") as file:
        for case, row in pool.map(one, todo):
            done[case] = row
            told = row if isinstance(row, str) else asdict(row)
            line = {"version": version, "drive": case[0], "fault": case[1], "row": told}
            file.write(json.dumps(line) + "\n")
            file.flush()
            print("  ".join(case) + "  " + _brief(row), flush=True)
    rows = in_order([row for c in cases if not isinstance(row := done[c], str)])
    skipped = [(*c, row) for c in cases if isinstance(row := done[c], str)]
    (args.out / "table.md").write_text(markdown(rows, skipped), encoding="utf-8")
    if args.docs:
        (PROJECT / "docs" / "faults.md").write_text(page(rows, skipped, version), encoding="utf-8")
    print()
    for row in rows:
        print("  ".join(cells_of(row)))
    print("\n".join(summary(rows)))
    return 1 if any(outcome(row)[0] == "failed" for row in rows) else 0


def _brief(row: Row | str) -> str:
    return row if isinstance(row, str) else "  ".join([*cells_of(row)[2:], row.told[-300:]])


if __name__ == "__main__":
    sys.exit(main())
