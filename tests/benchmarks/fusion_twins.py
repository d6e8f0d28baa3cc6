"""Delay and antenna of a recorded drive's twins, as the fusion finds them, against the truth.

    python tests/benchmarks/fusion_twins.py OUT [--seeds 20] [--arm X Y Z]

OUT is the folder of a run. Its twins follow the path of that run, with the errors and noises that
the run found and noise of their own; ``--arm`` gives them another antenna (m, vehicle axes) than
was found, so that a wrong arm costs something. The arm is not stated to the run that is judged.
Printed: the errors over their sigmas, by twin and pooled, how many of all are beyond three (of 80
right ones 0.2), and the mean NEES of the path (nine numbers: 9).
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from automap.io.tables import floats, read_table
from automap.records import FloatArray
from pipeline.cli.root import run_command
from pipeline.evaluate.command import evaluate_run
from pipeline.simulate.twin import write_twin

NAMES = ("delay", "arm x", "arm y", "arm z")
COLUMNS = tuple(f"gnss_lever_arm_{axis}" for axis in "xyz")


@dataclass(frozen=True)
class TwinScore:
    """What a twin's run made of ``NAMES``: ``found`` and ``sd`` [4] in s and m, the ``true`` ones;
    mean ``nees`` of its path and horizontal RMS, m."""

    found: FloatArray
    sd: FloatArray
    true: FloatArray
    nees: float
    horizontal_m: float

    @property
    def sigmas(self) -> FloatArray:
        """Errors [4] over their sigmas."""
        return (self.found - self.true) / self.sd


def twin_scores(
    out: Path, seeds: Sequence[int], work: Path, arm: Sequence[float] | None = None
) -> Iterator[TwinScore]:
    """Write, run and judge the twins of OUT under ``work``."""
    for seed in seeds:
        drive = work / f"twin-{seed}"
        drive.mkdir()
        changed = {} if arm is None else {"gnss_lever_arm": dict(zip("xyz", arm, strict=True))}
        write_twin(out, drive, seed, changed)
        manifest = drive / "drive.toml"
        lines = manifest.read_text().splitlines()
        kept = [line for line in lines if not line.startswith("lever_arm_m")]
        manifest.write_text("\n".join(kept) + "\n")
        if run_command(["run", str(drive), "--to", "fuse", "--quiet"]):
            raise RuntimeError(f"the run of {drive} failed")
        yield _score(drive)


def _score(drive: Path) -> TwinScore:
    out = drive / "_automap"
    told = json.loads((drive / "truth/errors.json").read_text())["errors"]
    fusion = json.loads((out / "fusion.json").read_text())
    table = read_table(out / "imu_errors.parquet", ("t_ns",))
    last = {name: float(floats(table, name)[-1]) for name in table.column_names if name != "t_ns"}
    figures = evaluate_run(out)
    return TwinScore(
        np.array([fusion["imu_delay_s"], *(last[c] for c in COLUMNS)]),
        np.array([fusion["imu_delay_sd_s"], *(last[f"sd_{c}"] for c in COLUMNS)]),
        np.array([told["imu_time_offset"]["s"], *(told["gnss_lever_arm"][a] for a in "xyz")]),
        figures["nees_mean"],
        figures["position_rms_m"]["horizontal"],
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--arm", type=float, nargs=3)
    options = parser.parse_args()
    scores = []
    with tempfile.TemporaryDirectory() as work:
        for score in twin_scores(options.out, range(options.seeds), Path(work), options.arm):
            scores.append(score)
            print(
                f"twin {len(scores) - 1}: delay {1e3 * score.found[0]:.1f} ms "
                f"(sd {1e3 * score.sd[0]:.1f}), arm {np.round(score.found[1:], 3)} m "
                f"(sd {np.round(score.sd[1:], 3)}), sigmas {np.round(score.sigmas, 1)}, "
                f"NEES {score.nees:.1f}, {score.horizontal_m:.3f} m",
                flush=True,
            )
    sigmas = np.array([score.sigmas for score in scores])
    for name, column in zip(NAMES, sigmas.T, strict=True):
        size = np.sqrt(np.mean(column**2))
        print(f"{name}: error over sigma {size:.2f}, mean {column.mean():+.2f}")
    print(
        f"{np.count_nonzero(np.abs(sigmas) > 3.0)} of {sigmas.size} beyond three sigmas, "
        f"NEES {np.mean([s.nees for s in scores]):.1f}, "
        f"horizontal {np.sqrt(np.mean([s.horizontal_m**2 for s in scores])):.3f} m"
    )


if __name__ == "__main__":
    main()
