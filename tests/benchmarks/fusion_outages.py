"""How far the trajectory drifts while there are no fixes.

    python tests/benchmarks/fusion_outages.py synthetic [--drives N]
    python tests/benchmarks/fusion_outages.py recorded DRIVE_OUT

``synthetic``: fixes off for 60 s in every 180 s, starts shifted, on simulated drives with a
MEMS sensor (angle random walk 0.3 deg/sqrt(h), velocity random walk 0.1 m/s/sqrt(h), gyro bias
200 deg/h) and centimetre fixes. ``recorded``: outages of 15 s and of 30 s every 45 s and 60 s
cut from a fused drive with carrier-phase fixes (its folder of results). Printed: the RMS over
outages of the largest horizontal error in each.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import numpy.typing as npt

from automap.frames import rpy_to_matrix
from automap.fusion.engine import fuse_imu_gnss
from automap.fusion.options import FusionOptions
from automap.fusion.result import FusionResult, Prior
from automap.interpolation import poses_at_gps
from automap.io.clock_json import read_clock
from automap.io.tables import read_imu
from automap.records import Fixes, FixType, FloatArray, Trajectory
from pipeline.run.fusion_inputs import read_usable_fixes
from tests.unit.fusion_drive import BASE_NS, CLOCK, Sensor, errors, record
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import GPS0, Receiver, receive, select

WARM_UP_S = 60.0


def outage_mask(
    t: FloatArray, length: float, period: float, first: float
) -> tuple[npt.NDArray[np.bool_], list[tuple[float, float]]]:
    """Times [k] inside outages, and the outages that end within the times."""
    begins = np.arange(first, float(t[-1]) - length - 5.0, period)
    spans = [(float(b), float(b) + length) for b in begins]
    mask = np.zeros(len(t), bool)
    for begin, end in spans:
        mask |= (t > begin) & (t < end)
    return mask, spans


def largest(t: FloatArray, horizontal: FloatArray, spans: list[tuple[float, float]]) -> list[float]:
    """Largest horizontal error in each span."""
    return [float(horizontal[(t >= a) & (t <= b)].max()) for a, b in spans]


def synthetic(seed: int, seconds: float = 780.0) -> tuple[list[float], list[float]]:
    """Largest horizontal drifts of the forward filter and smoothed, of one simulated drive."""
    rng = np.random.default_rng(seed)
    bias = np.radians(200.0) / 3600.0 * rng.standard_normal(3)
    force = 0.02 * rng.standard_normal(3)
    sensor = Sensor(
        gyro_noise=np.radians(0.3) / 60.0,
        accel_noise=0.1 / 60.0,
        gyro_bias=tuple(bias),
        accel_bias=tuple(force),
        gyro_scale=tuple(0.001 * rng.standard_normal(3)),
        accel_scale=tuple(0.001 * rng.standard_normal(3)),
        gyro_walk=np.radians(200.0) / 3600.0 * np.sqrt(2.0 / 3600.0),
        accel_walk=2e-3 * np.sqrt(2.0 / 3600.0),
        vibration=0.02,
    )
    motion = city_drive(seconds, seed, slip=True)
    receiver = Receiver(rate=1.0, wander=(0.0, 0.0, 0.0), white=(0.02, 0.02, 0.04), velocity=0.03)
    fixes = receive(motion, receiver, 100 + seed)
    fixes = Fixes(**{**vars(fixes), "fix_type": np.full(len(fixes), FixType.FIXED, np.int64)})
    mask, spans = outage_mask(fixes.gps_s - GPS0, 60.0, 180.0, WARM_UP_S + 20.0 * (seed % 6) + 40.0)
    imu = record(motion, sensor, 200 + seed)
    result = fuse_imu_gnss(
        imu,
        select(fixes, ~mask),
        CLOCK,
        FusionOptions(),
        Prior(0.0, 0.02),
        lever_arm=np.zeros(3),
    )
    t = (imu.t_ns - BASE_NS) * 1e-9
    both = []
    for trajectory in (result.filtered, result.trajectory):
        error = errors(trajectory, motion)
        both.append(largest(t, np.hypot(error[:, 0], error[:, 1]), spans))
    return both[0], both[1]


def recorded(
    folder: Path, length: float, period: float, first: float
) -> tuple[list[float], list[float]]:
    """Largest horizontal errors at the fixes that were cut, forward and smoothed."""
    imu, (fixes, _) = read_imu(folder / "imu.parquet"), read_usable_fixes(folder)
    clock = read_clock(folder / "sync.json")
    t = fixes.gps_s - fixes.gps_s[0]
    mask, spans = outage_mask(t, length, period, first)
    result = fuse_imu_gnss(
        imu, select(fixes, ~mask), clock, FusionOptions(), Prior(0.0, 0.1), lever_arm=None
    )
    good = mask & (fixes.fix_type == FixType.FIXED) & np.isfinite(fixes.lat_rad)
    forward, smoothed = [], []
    for trajectory, out in ((result.filtered, forward), (result.trajectory, smoothed)):
        horizontal = antenna_errors(trajectory, result, select(fixes, good))
        out += largest(t[good], horizontal, [s for s in spans if _any(t[good], s)])
    return forward, smoothed


def _any(t: FloatArray, span: tuple[float, float]) -> bool:
    return bool(((t >= span[0]) & (t <= span[1])).any())


def antenna_errors(trajectory: Trajectory, result: FusionResult, fixes: Fixes) -> FloatArray:
    """Horizontal distances [k] in m of the trajectory's antenna from the fixes."""
    poses = poses_at_gps(trajectory, fixes.gps_s)
    names = result.parameters.names
    lever = [result.parameters.values[-1, names.index(f"gnss_lever_arm_{a}")] for a in "xyz"]
    offset = rpy_to_matrix(poses.rpy) @ np.array(lever)
    north = (poses.lat_rad - fixes.lat_rad) * 6.37e6 + offset[:, 0]
    east = (poses.lon_rad - fixes.lon_rad) * 6.38e6 * np.cos(fixes.lat_rad) + offset[:, 1]
    return np.asarray(np.hypot(north, east))


def rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    kinds = parser.add_subparsers(dest="kind", required=True)
    simulated = kinds.add_parser("synthetic")
    simulated.add_argument("--drives", type=int, default=6)
    real = kinds.add_parser("recorded")
    real.add_argument("out", type=Path)
    options = parser.parse_args()
    if options.kind == "synthetic":
        forward, smoothed = [], []
        for seed in range(options.drives):
            f, s = synthetic(seed)
            forward += f
            smoothed += s
            print(f"drive {seed}: forward {rms(f):.2f} m, smoothed {rms(s):.2f} m", flush=True)
        print(
            f"{len(forward)} outages of 60 s: forward {rms(forward):.2f} m (target 8), "
            f"smoothed {rms(smoothed):.2f} m (target 2)"
        )
        return
    for length, period, target in ((15.0, 45.0, 0.4), (30.0, 60.0, 1.2)):
        forward, smoothed = [], []
        for first in (30.0, 45.0, 60.0):
            f, s = recorded(options.out, length, period, first)
            forward += f
            smoothed += s
        print(
            f"{len(forward)} outages of {length:.0f} s: forward {rms(forward):.2f} m, smoothed "
            f"{rms(smoothed):.2f} m (target {target}), largest {max(smoothed):.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
