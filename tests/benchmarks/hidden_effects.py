"""How often a hidden error is found and named, on drives that nobody has seen.

    python tests/benchmarks/hidden_effects.py [-o FOLDER] [--only KIND[,KIND]] [--match TEXT]
        [--subset MINUTES] [--jobs N] [--report]

Single effects, null drives, triples, formulas, effects that the library is made to forget, errors
of cars and sensors that are in no library ("outside"), and the camera's; drawn, written and judged
by tests/hidden_effects, which shares no code with the library's simulator. Every second effect,
null drive and triple has the errors of a real receiver ("-real"), where AUTOMAP_SHARED_DATA has
recordings with a reference; without them those are left out, and that is said. Each
finished case is one JSON line in FOLDER/results.jsonl with the version of the code; a second call
goes on where the first one stopped. Rates are printed with Clopper-Pearson intervals, and every
miss with what was said instead.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict
from hashlib import sha256
from multiprocessing import get_context
from multiprocessing.pool import AsyncResult
from pathlib import Path

PROJECT = Path(__file__).resolve().parent.parent.parent
COUNTS = {
    "effect": 250,
    "null": 300,
    "triple": 40,
    "formula": 30,
    "removed": 23,
    "outside": 75,
    "camera": 21,
}
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def code_version() -> str:
    """Digest of the library, the pipeline, their settings and the generator."""
    digest = sha256()
    for folder in ("automap", "pipeline", "configs", "tests/hidden_effects"):
        for path in sorted((PROJECT / folder).rglob("*")):
            if path.suffix in (".py", ".toml"):
                digest.update(path.relative_to(PROJECT).as_posix().encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def all_cases(kinds: list[str], match: str) -> list[str]:
    """Case ids with the kinds evenly mixed, so that a part of the list says something."""
    from tests.hidden_effects.cases import case_ids

    placed = []
    for kind in kinds:
        ids = case_ids(kind, COUNTS[kind])
        placed += [((i + 0.5) / len(ids), case_id) for i, case_id in enumerate(ids)]
    return [case_id for _, case_id in sorted(placed) if match in case_id]


def _one(case_id: str) -> tuple[str, dict[str, object] | str]:
    """In a worker: the verdict as plain values, or what went wrong."""
    from tests.hidden_effects.run_case import run_case

    try:
        return case_id, asdict(run_case(case_id))
    except Exception as error:
        return case_id, f"{type(error).__name__}: {error}"


def run(
    cases: list[str], jobs: int, deadline: float
) -> Iterator[tuple[str, dict[str, object] | str]]:
    """Verdicts as they come; no case is begun after ``deadline`` (monotonic seconds)."""
    for name in ONE_THREAD:
        os.environ[name] = "1"
    waiting = iter(cases)
    with get_context("spawn").Pool(jobs) as pool:
        running: list[AsyncResult[tuple[str, dict[str, object] | str]]] = []
        while True:
            while len(running) < jobs and time.monotonic() < deadline:
                case_id = next(waiting, None)
                if case_id is None:
                    break
                running.append(pool.apply_async(_one, (case_id,)))
            if not running:
                return
            done = [job for job in running if job.ready()]
            for job in done:
                running.remove(job)
                yield job.get()
            if not done:
                time.sleep(0.1)


def read_results(path: Path, version: str | None) -> dict[str, dict[str, object]]:
    """Finished cases of one version, or the latest line of each; a torn last line is left out."""
    out: dict[str, dict[str, object]] = {}
    if not path.exists():
        return out
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            row = json.loads(line)
        except ValueError:
            continue
        if version is None or row["version"] == version:
            out[row["verdict"]["id"]] = row["verdict"]
    return out


def main() -> int:
    """Run what is missing and print the rates; 1 where a case failed."""
    from tests.hidden_effects.cases import REAL
    from tests.hidden_effects.judge import Verdict
    from tests.hidden_effects.rates import report
    from tests.hidden_effects.real_receiver import shared_drives

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("-o", "--out", type=Path, default=PROJECT / "build" / "hidden_effects")
    parser.add_argument("--only", default=",".join(COUNTS), help="kinds, with commas between")
    parser.add_argument("--match", default="", help="cases whose name holds this text")
    parser.add_argument("--subset", type=float, default=float("inf"), help="minutes at most")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--any-version", action="store_true", help="take older code's cases too")
    parser.add_argument("--report", action="store_true", help="run nothing, print the rates")
    args = parser.parse_args()
    kinds = [kind for kind in args.only.split(",") if kind]
    unknown = [kind for kind in kinds if kind not in COUNTS]
    if unknown:
        parser.error(f"{unknown[0]} is no kind; there are {', '.join(COUNTS)}")
    args.out.mkdir(parents=True, exist_ok=True)
    results = args.out / "results.jsonl"
    version = code_version()
    cases = all_cases(kinds, args.match)
    if shared_drives() is None:
        here = [case_id for case_id in cases if not case_id.endswith(REAL)]
        print(
            f"skipped: {len(cases) - len(here)} cases with a real receiver's errors, since "
            "AUTOMAP_SHARED_DATA holds no drives with a reference",
            flush=True,
        )
        cases = here
    finished = read_results(results, None if args.any_version else version)
    failed = []
    if not args.report:
        todo = [case_id for case_id in cases if case_id not in finished]
        print(f"{len(todo)} of {len(cases)} cases to run, code {version}", flush=True)
        deadline = time.monotonic() + 60.0 * args.subset
        for case_id, verdict in run(todo, args.jobs, deadline):
            if isinstance(verdict, str):
                failed.append(f"{case_id} failed: {verdict}")
                print(failed[-1], flush=True)
                continue
            finished[case_id] = verdict
            line = json.dumps({"version": version, "verdict": verdict})
            with results.open("a", encoding="utf-8") as file:
                file.write(line + "\n")
            names = ", ".join(verdict["named"]) or "-"  # type: ignore[arg-type]
            print(f"{case_id:<40} {verdict['outcome']:<16} {names}", flush=True)
    chosen = [Verdict(**finished[c]) for c in cases if c in finished]  # type: ignore[arg-type]
    print("\n" + "\n".join(report(chosen) + failed))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.path.insert(0, str(PROJECT))
    sys.exit(main())
