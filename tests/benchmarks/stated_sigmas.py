"""Are sigmas of paths as large as their errors, and ellipses of 95 % right, over many drives?

    python tests/benchmarks/stated_sigmas.py DRIVE... [-o FOLDER]

Each ``DRIVE`` is a folder with ``truth/trajectory.csv``. It goes through ``automap run --to fuse``
as it is and without its IMU. Printed are, a line for each run and the means over all: the share in
the ellipse (interval) of 95 %, and the mean squared error over its variance (NEES, 1 is right) of
the level position, the height, the velocity, and the heading while the vehicle drives; velocities
are compared with the truth's own, and as ``moved`` with what its positions change by over a minute.
Where these differ one of them is the reference's error: of KITTI the positions (by its velocities
the car climbs 0.28 to 0.53 deg steeper than its nose points on six drives of one day, by its
heights 0.27 to 0.89 deg), of the phones' reference the velocities east. ``lasts`` is by which
factor on the lasting errors of positions, of those from a sixteenth to eight, the fixes'
innovations beside velocities are likeliest, beside the RMS of the fixes' errors, m an axis.

Errors of receivers last for minutes and hours, so that a drive lies in its ellipses as a whole or
not at all: of honest sigmas most drives have a share of 1.00, one in twenty has 0.00. Only means
over drives, and over receivers, say something.
"""

from __future__ import annotations

import argparse
import re
import shutil
import sys
from pathlib import Path

import numpy as np

PROJECT = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(PROJECT))

from automap.evaluation.reference import velocity_apart  # noqa: E402
from automap.evaluation.trajectory_errors import raw_fix_errors, trajectory_errors  # noqa: E402
from automap.fusion.doubts.receiver import dated_velocities  # noqa: E402
from automap.fusion.fix_axes import smooth_epochs, usable_epochs  # noqa: E402
from automap.fusion.limits import DRIVING_SPEED  # noqa: E402
from automap.fusion.options import FusionOptions  # noqa: E402
from automap.gates import OUTSIDE_95, gate  # noqa: E402
from automap.io import names  # noqa: E402
from automap.io.trajectory_table import read_trajectory  # noqa: E402
from automap.io.truth_trajectory import read_truth_trajectory  # noqa: E402
from automap.records import FloatArray  # noqa: E402
from pipeline.run.fusion_inputs import read_usable_fixes  # noqa: E402
from tests.benchmarks.faults.run import automap  # noqa: E402

PARTS = {"level": [0, 1], "height": [2], "velocity": [3, 4, 5], "moved": [3, 4, 5], "heading": [8]}
WITH, WITHOUT = "IMU", "alone"
OPTIONS = FusionOptions()


def without_imu(drive: Path, folder: Path) -> Path:
    """A copy of the drive that has no IMU."""
    shutil.rmtree(folder, ignore_errors=True)
    leave = shutil.ignore_patterns("imu*", "video", "_automap")
    shutil.copytree(drive, folder, ignore=leave, copy_function=shutil.copyfile)
    folder.chmod(0o755)
    text = (drive / "drive.toml").read_text(encoding="utf-8")
    manifest = folder / "drive.toml"
    manifest.write_text(re.sub(r"(?ms)^\[(imu|camera)[^\n]*\n.*?(?=^\[|\Z)", "", text), "utf-8")
    return folder


def figures(out: Path, truth_file: Path) -> dict[str, tuple[float, float]]:
    """Share in the ellipse of 95 % and NEES by part of the path in ``out``."""
    truth = read_truth_trajectory(truth_file)
    errors = trajectory_errors(read_trajectory(out / names.TRAJECTORY), truth)
    drives = np.hypot(truth.vel_ned[:, 0], truth.vel_ned[:, 1]) > DRIVING_SPEED
    moved = errors.error.copy()
    moved[:, 3:6] += np.nan_to_num(velocity_apart(truth))
    found = {}
    for part, columns in PARTS.items():
        error = moved if part == "moved" else errors.error
        ratio: FloatArray = error[:, columns] / errors.sd[:, columns]
        ratio = ratio[drives if part == "heading" else slice(None)]
        squares = (ratio[np.isfinite(ratio).all(axis=1)] ** 2).sum(axis=1)
        if len(squares):
            inside = float(np.mean(squares < gate(OUTSIDE_95, len(columns))))
            found[part] = inside, float(squares.mean()) / len(columns)
    return found


def lasting(out: Path, truth_file: Path) -> str:
    """What innovations make of the positions' lasting errors, and what these are."""
    fixes, receiver = read_usable_fixes(out)
    at = usable_epochs(dated_velocities(fixes, receiver), OPTIONS)
    steps = 2.0 ** np.arange(-4, 4)

    def score(lasts: float, white: float, velocity: float) -> float:
        levels = {"wander": lasts, "multipath": lasts, "position_h": white, "velocity_h": velocity}
        return sum(smooth_epochs(at, axis, OPTIONS, levels, np.zeros((0, 4))) for axis in (0, 1))

    best = [max(score(k, w, v) for w in steps[:6] for v in steps[1:6]) for k in steps]
    errors = raw_fix_errors(fixes, read_truth_trajectory(truth_file), np.zeros(3))[:, :2]
    errs = f"{np.sqrt(np.mean(errors**2)):.2f} m" if len(errors) else "unknown, without GPS time"
    return f"lasts x{steps[int(np.argmax(best))]:.2g} errs {errs}"


def _line(name: str, how: str, found: dict[str, tuple[float, float]], told: str = "") -> str:
    parts = [f"{part} {inside:.2f} {nees:6.2f}" for part, (inside, nees) in found.items()]
    return "  ".join([f"{name:20.20} {how:5}", *parts, told])


def main() -> int:
    """Run, print; 1 where a run failed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("drives", nargs="+", type=Path)
    parser.add_argument("-o", "--out", type=Path, default=PROJECT / "build" / "stated_sigmas")
    args = parser.parse_args()
    failed = 0
    every: dict[str, list[dict[str, tuple[float, float]]]] = {WITH: [], WITHOUT: []}
    for drive in args.drives:
        for how in every:
            work = args.out / f"{drive.name}-{how}"
            folder = drive if how == WITH else without_imu(drive, work / "drive")
            arguments = "run", str(folder), "-o", str(work / "out"), "--to", "fuse", "--quiet"
            code, message = automap(*arguments)
            if code:
                failed += 1
                print(f"{drive.name} {how}: {message[-300:]}", flush=True)
                continue
            found = figures(work / "out", drive / "truth" / "trajectory.csv")
            every[how].append(found)
            truth = drive / "truth" / "trajectory.csv"
            told = lasting(work / "out", truth) if how == WITHOUT else ""
            print(_line(drive.name, how, found, told), flush=True)
    for how, all_found in every.items():
        mean = {}
        for part in PARTS:
            rows = np.array([found[part] for found in all_found if part in found])
            if len(rows):
                mean[part] = float(rows[:, 0].mean()), float(rows[:, 1].mean())
        print(_line(f"mean of {len(all_found)}", how, mean))
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
