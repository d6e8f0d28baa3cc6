"""Receivers that no preset has: drawn at random, put on simulated drives, and what a run says then.

    python tests/benchmarks/drawn_receivers.py SEED... [-o FOLDER] [--seconds S] [--set SETTING]

Of each seed a drive with its IMU is simulated; the receiver is not the simulator's: rate, format,
how far it errs and for how long, what it states of that, how late positions, speeds and courses
are, its clock, filters, repeated positions at rest, rounding, lost epochs and worse stretches are
drawn here, from what data sheets and recordings have and somewhat beyond. Printed for each seed:
RMS of the fixes and of the path in the plane and in height, errors over their sigmas by component,
the verdict with its reasons, and the receiver. A line is marked W where the path is worse than the
fixes, B where errors are beyond their sigmas and nothing is doubted, L where the sigmas are three
times too large, and D where a drive is doubted that is within them.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import asdict, dataclass, replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from automap import earth
from automap.evaluation.trajectory_errors import raw_fix_errors, trajectory_errors
from automap.frames import rpy_to_matrix
from automap.interpolation import poses_at_gps
from automap.io import names
from automap.io.nmea_writer import gga_rmc
from automap.io.tables import read_fixes
from automap.io.trajectory_table import read_trajectory
from automap.io.truth_trajectory import read_truth_trajectory
from automap.io.ubx_writer import nav_pvt
from automap.records import NO_TIME, Fixes, FixType, FloatArray, Trajectory
from automap.simulation.gnss import arrivals
from automap.simulation.scenario import Scenario, parse_scenario
from pipeline.cli.root import run_command
from pipeline.simulate.drive_writer import write_drive
from tests.benchmarks.drive_to_map import draw_scenario
from tests.benchmarks.faults.judge import verdict_of

ARM = (0.4, 0.1, -1.2)
COMPONENTS = ("n", "e", "d", "vn", "ve", "vd", "roll", "pitch", "yaw")
WORSE, WITHIN = 1.05, 0.33
BEYOND = np.repeat([1.5, 1.5, 2.5], 3)
"""Of attitudes one error of a sensor makes all of a drive's."""


@dataclass(frozen=True)
class Receiver:
    """A receiver in m, s, m/s; ``stated`` what it states over what is true."""

    format: str
    rate_hz: float
    wander: float
    lasting_s: float
    white: float
    up: float
    velocity: float
    velocity_lasting_s: float
    stated: float
    late: float
    speed_late: float
    course_late: float
    clock: float
    filter_s: float
    holds_below: float
    places: float
    lost: float
    worse: float
    """By so much in some stretches, which it does not state."""
    velocities: str
    """``measured``, or ``differences`` of its positions."""


def draw(rng: np.random.Generator) -> Receiver:
    """A receiver; half of what can be wrong with one is not."""

    def or_none(value: float, share: float = 0.5) -> float:
        return float(value) if rng.random() < share else 0.0

    stated = float(np.exp(rng.normal(0.0, 0.7)))  # drawn first: the seeds' other draws stay
    return Receiver(
        format=str(rng.choice(["nmea", "ubx"])),
        rate_hz=float(rng.choice([1.0, 2.0, 5.0, 10.0], p=[0.4, 0.1, 0.3, 0.2])),
        wander=float(np.exp(rng.uniform(np.log(0.3), np.log(5.0)))),
        lasting_s=float(np.exp(rng.uniform(np.log(3.0), np.log(200.0)))),
        white=float(np.exp(rng.uniform(np.log(0.05), np.log(1.0)))),
        up=float(rng.uniform(1.0, 3.0)),
        velocity=float(np.exp(rng.uniform(np.log(0.03), np.log(0.4)))),
        velocity_lasting_s=float(rng.choice([0.0, 2.0, 10.0])),
        stated=stated,
        late=or_none(rng.uniform(-0.1, 0.6)),
        speed_late=or_none(rng.uniform(0.0, 0.8)),
        course_late=or_none(rng.uniform(0.0, 0.4), 0.3),
        clock=or_none(rng.uniform(-1.0, 1.0), 0.2),
        filter_s=or_none(rng.uniform(0.1, 1.0), 0.25),
        holds_below=or_none(rng.uniform(0.3, 1.0), 0.3),
        places=float(rng.choice([1e-4, 1e-2, 0.1, 0.5], p=[0.5, 0.2, 0.2, 0.1])),
        lost=or_none(rng.uniform(0.0, 0.2), 0.3),
        worse=float(rng.choice([1.0, 2.0, 5.0], p=[0.6, 0.2, 0.2])),
        velocities=str(rng.choice(["measured", "differences"], p=[0.85, 0.15])),
    )


def wandering(rng: np.random.Generator, t: FloatArray, lasting_s: float, k: int) -> FloatArray:
    """First-order Gauss-Markov processes [n, k] of one sigma; white where nothing lasts."""
    out: FloatArray = rng.standard_normal((len(t), k))
    if lasting_s <= 0.0:
        return out
    keep = np.exp(-np.diff(t) / lasting_s)
    for i, share in enumerate(keep.tolist()):
        out[i + 1] = share * out[i] + np.sqrt(1.0 - share**2) * out[i + 1]
    return out


def received(truth: Trajectory, one: Receiver, rng: np.random.Generator) -> Fixes:
    """What the receiver tells along a path."""
    begin, end = truth.gps_s[0] + 1.5, truth.gps_s[-1] - 1.5
    tag = np.arange(np.ceil(begin * one.rate_hz), np.floor(end * one.rate_hz)) / one.rate_hz
    n = len(tag)

    def at(late: float) -> tuple[FloatArray, FloatArray]:
        """Antenna in NED about the first row, and its velocity, ``late`` s before the tags."""
        when = np.clip(tag - one.clock - late, truth.gps_s[0], truth.gps_s[-1])
        step = 0.05
        places = [_antenna(truth, np.clip(when + s, begin - 1.5, end + 1.5)) for s in (-step, step)]
        return _antenna(truth, when), (places[1] - places[0]) / (2.0 * step)

    place, _ = at(one.late)
    _, speed = at(one.late + one.speed_late)
    _, course = at(one.late + one.speed_late + one.course_late)
    if one.filter_s > 0.0:
        share = 1.0 - np.exp(-1.0 / (one.rate_hz * one.filter_s))
        for i in range(1, n):
            place[i] = place[i - 1] + share * (place[i] - place[i - 1])
    length = np.hypot(*course[:, :2].T)
    turned = length > 0.5
    speed[turned, :2] = (
        course[turned, :2] * (np.hypot(*speed[turned, :2].T) / length[turned])[:, None]
    )
    size = np.array([1.0, 1.0, one.up])
    stretch = np.where(np.sin(2.0 * np.pi * (tag - tag[0]) / 90.0 + 1.0) > 0.7, one.worse, 1.0)
    error = one.wander * wandering(rng, tag, one.lasting_s, 3)
    error += one.white * rng.standard_normal((n, 3))
    place = place + error * size * stretch[:, None]
    velocity = speed + one.velocity * wandering(rng, tag, one.velocity_lasting_s, 3)
    if one.velocities == "differences":
        velocity = np.gradient(place, tag, axis=0)
    stands = np.hypot(*speed[:, :2].T) < one.holds_below
    velocity[stands] = 0.0
    for i in np.flatnonzero(stands[1:]) + 1:
        place[i] = place[i - 1]
    place = np.round(place / one.places) * one.places
    kept = rng.random(n) >= one.lost
    told = np.hypot(one.wander, one.white) * one.stated * size
    lat, lon, height = earth.from_local_ned(place, _origin(truth))
    fixes = Fixes(
        gps_s=tag,
        lat_rad=lat,
        lon_rad=lon,
        height_m=height,
        vel_ned=velocity,
        sd_pos_ned=np.tile(told, (n, 1)),
        sd_vel_ned=np.full((n, 3), max(one.velocity * one.stated, 0.01)),
        fix_type=np.full(n, int(FixType.THREE_D)),
        n_sats=np.full(n, 12),
        hdop=np.full(n, 0.9),
        geoid_sep_m=np.zeros(n),
        offset=np.full(n, -1, np.int64),
        arrival_ns=np.full(n, NO_TIME, np.int64),
    )
    return replace(fixes, **{name: value[kept] for name, value in vars(fixes).items()})


def _origin(truth: Trajectory) -> tuple[float, float, float]:
    return float(truth.lat_rad[0]), float(truth.lon_rad[0]), float(truth.height_m[0])


def _antenna(truth: Trajectory, gps_s: FloatArray) -> FloatArray:
    poses = poses_at_gps(truth, gps_s)
    place = earth.local_ned(poses.lat_rad, poses.lon_rad, poses.height_m, _origin(truth))
    return np.asarray(place + rpy_to_matrix(poses.rpy) @ np.array(ARM))


def scenario_of(rng: np.random.Generator, seconds: float) -> Scenario:
    """A drive through streets with an IMU as low-cost ones are, shaken by the road."""
    drawn = draw_scenario(rng, seconds)
    for name in ("camera", "signs"):
        drawn.pop(name)
    drawn["errors"] = {k: v for k, v in drawn["errors"].items() if not k.startswith("camera")}
    drawn["gnss"] = {"lever_arm_m": list(ARM), "output_delay_known": False}
    noisy = float(np.exp(rng.uniform(0.0, np.log(8.0))))
    drawn["imu"] = {"gyro_noise": 1e-4 * noisy, "accel_noise": 1.5e-3 * noisy}
    return parse_scenario(drawn, Path("drawn.toml"))


def write(folder: Path, seed: int, seconds: float) -> Receiver:
    """The drive folder of a seed, with its truth."""
    rng = np.random.default_rng([seed, 20])
    scenario = scenario_of(rng, seconds)
    folder.mkdir(parents=True)
    write_drive(scenario, folder)
    assert scenario.gnss is not None
    one, truth = draw(rng), read_truth_trajectory(folder / names.TRUTH_DIR / names.TRUTH_TRAJECTORY)
    fixes = received(truth, one, rng)
    for path in folder.glob("gnss*"):
        path.unlink()
    setup = scenario.gnss
    messages = gga_rmc(fixes) if one.format == "nmea" else nav_pvt(fixes)

    def host(gps_s: FloatArray) -> Any:
        return (
            np.interp(gps_s, truth.gps_s, truth.t_ns - truth.t_ns[0]).astype(np.int64)
            + (truth.t_ns[0])
        )

    stamps = arrivals(fixes.gps_s - one.clock, setup, host, rng)
    (folder / f"gnss.{one.format}").write_bytes(b"".join(messages))
    offsets = np.cumsum([0] + [len(m) for m in messages[:-1]])
    rows = "".join(f"{o},{t}\n" for o, t in zip(offsets, stamps, strict=True))
    (folder / "gnss_arrival.csv").write_text("offset,t_ns\n" + rows)
    manifest = folder / names.MANIFEST
    manifest.write_text(manifest.read_text().replace("gnss.ubx", f"gnss.{one.format}"))
    (folder / names.TRUTH_DIR / "receiver.json").write_text(json.dumps(asdict(one)))
    return one


def judged(folder: Path, out: Path, settings: Sequence[str]) -> str:
    """What came of a run, in a line."""
    told, errors = StringIO(), StringIO()
    with redirect_stdout(told), redirect_stderr(errors):
        words = [word for setting in settings for word in ("--set", setting)]
        code = run_command(["run", str(folder), "-o", str(out), "--to", "fuse", "--quiet", *words])
    state, reasons = verdict_of(out)
    if code:
        return f"exit {code}: {errors.getvalue().strip()[:200]}"
    truth = read_truth_trajectory(folder / names.TRUTH_DIR / names.TRUTH_TRAJECTORY)
    # the clock is not the path's error: it is compared by the host's time
    found = trajectory_errors(read_trajectory(out / "trajectory.parquet"), truth)
    raw = raw_fix_errors(read_fixes(out / "fixes.parquet"), truth, np.array(ARM))
    level = np.sqrt(np.nanmean(np.sum(found.error[:, :2] ** 2, axis=1)))
    height = np.sqrt(np.nanmean(found.error[:, 2] ** 2))
    fixes = np.sqrt(np.nanmean(np.sum(raw[:, :2] ** 2, axis=1)))
    ratio = np.sqrt(np.nanmean((found.error / found.sd) ** 2, axis=0))
    marks = "".join(
        mark
        for mark, is_so in (
            ("W", level > WORSE * fixes + 0.1),
            ("B", (ratio > BEYOND).any() and state in ("good", "usable")),
            ("L", float(np.max(ratio[:3])) < WITHIN),
            ("D", state not in ("good", "usable") and (ratio < BEYOND).all()),
        )
        if is_so
    )
    ratios = " ".join(f"{name} {r:.2f}" for name, r in zip(COMPONENTS, ratio, strict=True))
    codes = ",".join(reason.code for reason in reasons)
    return (
        f"{marks or '-':3} fixes {fixes:.2f} path {level:.2f} height {height:.2f}; {ratios}; "
        f"{state} {codes}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("seeds", nargs="+", type=int)
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--seconds", type=float, default=400.0)
    parser.add_argument("--set", action="append", default=[], help="settings of the run")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        base = options.output or Path(made)
        for seed in options.seeds:
            folder, out = base / f"{seed}" / "drive", base / f"{seed}" / "out"
            shutil.rmtree(out, ignore_errors=True)
            if folder.is_dir():
                told = (folder / names.TRUTH_DIR / "receiver.json").read_text()
                one = Receiver(**json.loads(told))
            else:
                one = write(folder, seed, options.seconds)
            print(f"{seed} {judged(folder, out, options.set)}", flush=True)
            drawn = {k: round(v, 3) if isinstance(v, float) else v for k, v in vars(one).items()}
            print(f"      {drawn}", flush=True)
            if options.output is None:
                shutil.rmtree(base / f"{seed}")


if __name__ == "__main__":
    main()
