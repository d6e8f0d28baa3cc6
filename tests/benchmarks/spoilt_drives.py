"""Recorded drives of which one thing is spoilt: is the change named, and its size recovered?

    python tests/benchmarks/spoilt_drives.py [-o FOLDER] [--drive TEXT] [--change TEXT]
        [--jobs N] [--report]

Each drive is searched as it is, which is the baseline, and with one change at a time: the
stated lever arm 0.5 m off, fixes tagged 50 ms late, the IMU turned by 1.5 deg, the receiver's
velocity through a low-pass of 0.15 s, one gyro axis reading 1 % of another or its own 1.5 % too
large, one axis of the accelerometer 0.015 of another, the IMU's stamps 0.12 s late. A change is
recovered where spoilt less baseline is within 3 sigma of it. Two searches may tell one thing by
different names, or leave it below what is named (an antenna 0.13 m off; a turned IMU that a turned
gyro triad can say as well). So beside the findings of the unspoilt drive stands what it says of the
effects that were named on the spoilt one, and both comparisons are printed. Where the change is
told as what a named effect cannot be told from, both drives are fitted with both ("pair"): the
positions of the KITTI reference run 0.05 to 0.07 s ahead of its own velocities, so fixes that come
50 ms late have right positions there, and late velocities. The drives come from
AUTOMAP_SHARED_DATA; each finished case is one JSON line in FOLDER/results.jsonl with the version
of the code, and a second call goes on where the first one stopped.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from automap.gap import GapDrive, GapResult
    from automap.records import FloatArray

PROJECT = Path(__file__).resolve().parent.parent.parent
DATA = Path(os.environ.get("AUTOMAP_SHARED_DATA") or PROJECT / ".." / "shared" / "data")
DRIVES = {
    "rtk-car-a": 300.0,
    "kitti-20110930-0033": 200.0,
    "kitti-20110930-0020": 200.0,
    "kitti-20111003-0034": 240.0,
}
"""Drives and the seconds of each that are taken."""
WIDE = 5.0
"""Factor on the usual sizes of the effects that both drives are fitted with."""
ARM_M, DELAY_S, TURN, LAG_S, CROSS = 0.5, 0.05, np.deg2rad(1.5), 0.15, 0.01
SCALE, SKEWED, IMU_LATE_S = 0.015, 0.015, 0.12

Terms = Sequence[tuple[str, str, float]]
"""Effect, parameter and sign of what adds up to the quantity that was changed."""
CHANGES: Mapping[str, tuple[float, Terms]] = {
    "lever arm": (-ARM_M, [("gnss_lever_arm", "x", 1.0)]),
    "delay": (DELAY_S, [("gnss_latency", "s", 1.0), ("imu_time_offset", "s", -1.0)]),
    "mounting": (TURN, [("imu_mounting", "yaw", 1.0)]),
    "velocity lag": (
        LAG_S,
        [("gnss_velocity_lag", "tau", 1.0), ("gnss_velocity_latency", "s", 1.0)],
    ),
    "cross-coupling": (CROSS, [("gyro_misalignment", "xz", 1.0)]),
    "gyro scale": (SCALE, [("gyro_scale", "z", 1.0)]),
    "accel misalignment": (SKEWED, [("accel_misalignment", "yx", 1.0)]),
    "IMU delay": (
        IMU_LATE_S,
        [("imu_time_offset", "s", 1.0), ("gnss_latency", "s", -1.0)],
    ),
}


def low_passed(t: FloatArray, velocity: FloatArray, tau: float) -> FloatArray:
    """First-order low-pass of a path's velocity [n, 3], exact for velocity linear in time."""
    out = velocity.copy()
    for i in range(1, len(t)):
        dt = t[i] - t[i - 1]
        keep = np.exp(-dt / tau)
        slope = (velocity[i] - velocity[i - 1]) / max(dt, 1e-9)
        # the response to a ramp trails by slope * tau
        settled = velocity[i - 1] - slope * tau
        out[i] = settled + slope * dt + (out[i - 1] - settled) * keep
    return out


def spoilt(drive: GapDrive, change: str, path: tuple[FloatArray, FloatArray]) -> GapDrive:
    """The drive in vehicle axes with one change; ``path`` fixes' GPS times [n] and velocity
    [n, 3] along the drive, for the low-pass."""
    imu, fixes = drive.imu, drive.fixes
    if change == "lever arm":
        stated = np.zeros(3) if drive.lever_arm is None else np.asarray(drive.lever_arm)
        return replace(drive, lever_arm=stated + np.array([ARM_M, 0.0, 0.0]))
    if change == "delay":
        return replace(drive, fixes=replace(fixes, gps_s=fixes.gps_s + DELAY_S))
    if change == "mounting":
        c, s = np.cos(TURN), np.sin(TURN)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        turned = replace(imu, gyro=imu.gyro @ turn.T, accel=imu.accel @ turn.T)
        return replace(drive, imu=turned)
    if change == "velocity lag":
        t, velocity = path
        less = low_passed(t, velocity, LAG_S) - velocity
        seen = np.stack([np.interp(fixes.gps_s, t, v) for v in less.T], axis=1)
        return replace(drive, fixes=replace(fixes, vel_ned=fixes.vel_ned + seen))
    if change == "cross-coupling":
        gyro = imu.gyro.copy()
        gyro[:, 0] += CROSS * gyro[:, 2]
        return replace(drive, imu=replace(imu, gyro=gyro))
    if change == "gyro scale":
        gyro = imu.gyro.copy()
        gyro[:, 2] *= 1.0 + SCALE
        return replace(drive, imu=replace(imu, gyro=gyro))
    if change == "accel misalignment":
        accel = imu.accel.copy()
        accel[:, 1] += SKEWED * accel[:, 0]
        return replace(drive, imu=replace(imu, accel=accel))
    if change == "IMU delay":
        late = imu.t_ns + round(IMU_LATE_S * 1e9)
        return replace(drive, imu=replace(imu, t_ns=late))
    return drive


def motion_of_drive(drive: GapDrive) -> tuple[FloatArray, FloatArray]:
    """GPS times [n] of the IMU's samples and the velocity [n, 3] that an ordinary fit gives."""
    from automap.gap import base_model
    from automap.gap.drive import open_drive
    from automap.gap.fit import fit_drive
    from automap.gap.motion import motion_of

    model = base_model()
    motion = motion_of(fit_drive(open_drive(drive, model.options), model).last)
    t_ns = drive.imu.t_ns[0] + np.rint(motion.t * 1e9).astype(np.int64)
    return drive.clock.gps_s(t_ns), motion.vel


def search(name: str, change: str, runs: Path) -> dict[str, Any]:
    """Findings on one spoilt drive as plain values."""
    from automap.fusion.options import FusionOptions
    from automap.gap import find_gaps
    from automap.gap.drive import in_vehicle_axes
    from pipeline.gap.inputs import gap_drives, gap_model

    model, settings = gap_model(None)
    (drive,) = gap_drives([DATA / "drives" / name], runs / f"{name}-{change}", settings)
    if drive.length_s > DRIVES[name]:
        drive = drive.part(0.0, DRIVES[name], name)
    # axes found by an ordinary run count as stated, or no turn could be missed
    drive = in_vehicle_axes(drive, FusionOptions())
    if change in ("mounting", "baseline of mounting"):
        drive = replace(drive, mounting_sd=np.zeros(3))
    path = motion_of_drive(drive) if change == "velocity lag" else (np.zeros(1), np.zeros((1, 3)))
    start = time.process_time()
    changed = spoilt(drive, change, path)
    result = find_gaps([changed], (), model)
    cpu_s = time.process_time() - start
    # noise that is named is no state of the filter
    names = [f.effect for f in result.findings if f.effect in result.model.values]
    out = {"cpu_s": cpu_s, **told(result), "unspoilt": same_effects(drive, result, names)}
    also = alike(result, change)
    if also is not None:
        both = (same_effects(each, result, [*names, also]) for each in (drive, changed))
        out["unspoilt_with_both"], out["spoilt_with_both"] = both
    return out


def alike(result: GapResult, change: str) -> str | None:
    """The changed effect where it was told as what a named one cannot be told from."""
    family = [effect for effect, _, _ in CHANGES.get(change, (0.0, []))[1]]
    named = {f.effect for f in result.findings}
    confusable = {e for f in result.findings for e in f.confusable_with}
    return next((e for e in family if e in confusable and not named & set(family)), None)


def same_effects(drive: GapDrive, result: GapResult, names: Sequence[str]) -> list[dict[str, Any]]:
    """What a drive says of the effects ``names``, with its own noise."""
    from automap.gap.drive import open_drive
    from automap.gap.fit import fit_drive
    from automap.gap.limits import FIT_SHARE
    from automap.gap.noise import fit_noise
    from tests.unit.gap_values import estimates

    base = result.base
    opened = open_drive(drive.part(0.0, FIT_SHARE * drive.length_s, drive.name), base.options)
    estimate = dict.fromkeys(names, WIDE)
    model = replace(base, factors=result.model.factors)
    fit = fit_drive(opened, model, estimate)
    for _ in range(2):
        model = replace(model, factors=fit_noise([fit]))
        fit = fit_drive(opened, model, estimate, linearised_at=fit)
    return [
        {
            "effect": e,
            "values": {p: list(each) for p, each in estimates(fit, e).items()},
        }
        for e in names
    ]


def told(result: GapResult) -> dict[str, Any]:
    """A result as plain values."""
    return {
        "findings": [
            {
                "effect": f.effect,
                "values": {p: [v.value, v.sd] for p, v in f.parameters.items()},
                "nats": f.evidence_nats,
                "confusable_with": list(f.confusable_with),
            }
            for f in result.findings
        ],
        "formulas": [formula.formula for formula in result.formulas],
        "misfits": [f"{m.channel} {m.where}" for m in result.misfits],
        "gap": [result.gap_before, result.gap_after],
        "warnings": list(result.warnings),
    }


def amount(findings: Sequence[Mapping[str, Any]], terms: Terms) -> tuple[float, float]:
    """Size and sd of a quantity by the findings, 0 where none has a part of it."""
    value, var = 0.0, 0.0
    for finding in findings:
        for effect, parameter, sign in terms:
            if finding["effect"] == effect:
                size, sd = finding["values"][parameter]
                value, var = value + sign * size, var + sd**2
    return value, float(np.sqrt(var))


def verdict(
    baseline: Mapping[str, Any], case: Mapping[str, Any], change: str
) -> tuple[bool, bool, str]:
    """Whether a change was named and recovered, against the unspoilt drive's own findings and
    against what it says of the same effects, and a line that says how."""
    true, terms = CHANGES[change]
    names = [f["effect"] for f in case["findings"]]
    family = {effect for effect, _, _ in terms}
    named = bool(family & set(names))
    after, after_sd = amount(case["findings"], terms)
    found, text = [], []
    for before, before_sd in (
        amount(baseline["findings"], terms),
        amount(case["unspoilt"], terms),
    ):
        off = (after - before - true) / max(float(np.hypot(before_sd, after_sd)), 1e-12)
        found.append(named and abs(off) < 3.0)
        text.append(f"{after - before:+.4g} ({off:+.1f} sigma)")
    pair = [f["effect"] for f in case["findings"] if family & set(f["confusable_with"])]
    mark = "ok  " if all(found) else "same" if found[1] else "own " if found[0] else "MISS"
    line = f"{mark} {change:<15} {true:+.4g}: "
    line += f"own findings {text[0]}, same effects {text[1]}" if named else "not named"
    if not named and pair:
        line += f" but confusable with {', '.join(pair)}"
    if "spoilt_with_both" in case:
        before, before_sd = amount(case["unspoilt_with_both"], terms)
        after, after_sd = amount(case["spoilt_with_both"], terms)
        off = (after - before - true) / max(float(np.hypot(before_sd, after_sd)), 1e-12)
        line = line.replace("MISS", "pair" if abs(off) < 3.0 else "MISS", 1)
        line += f", with both {before:+.4g} becomes {after:+.4g} ({off:+.1f} sigma)"
    line += f"; {', '.join(names) or '-'}"
    if case["formulas"]:
        line += f"; outside the library {', '.join(case['formulas'])}"
    return found[0], found[1], line


def report(done: Mapping[tuple[str, str], Mapping[str, Any]]) -> list[str]:
    """Lines on all finished cases, drive by drive."""
    lines, own, same, pairs, count = [], 0, 0, 0, 0
    for name in DRIVES:
        base = done.get((name, "baseline"))
        if base is None:
            continue
        lines.append(f"{name}: baseline, {base['cpu_s']:.0f} s")
        for finding in base["findings"]:
            values = ", ".join(f"{p} {v:.3g}±{s:.1g}" for p, (v, s) in finding["values"].items())
            lines.append(f"       {finding['effect']} ({values}) {finding['nats']:.0f} nats")
        lines += [f"       outside the library {formula}" for formula in base["formulas"]]
        for change in CHANGES:
            if (name, change) in done:
                plain = done.get((name, f"baseline of {change}"), base)
                by_own, by_same, line = verdict(plain, done[name, change], change)
                own, same, count = own + by_own, same + by_same, count + 1
                pairs += line.startswith("pair")
                lines.append(f"  {line}")
    lines.append(
        f"named and recovered within 3 sigma: {same} of {count} against the same effects on the "
        f"unspoilt drive, {own} of {count} against its own findings; {pairs} more told as what a "
        "named effect cannot be told from"
    )
    return lines


def _one(task: tuple[str, str, Path]) -> tuple[str, str, dict[str, Any] | str]:
    name, change, runs = task
    try:
        return name, change, search(name, change, runs)
    except Exception as error:
        return name, change, f"{type(error).__name__}: {error}"


def main() -> int:
    """Run what is missing and print the verdicts; 1 where a case failed."""
    from tests.benchmarks.hidden_effects import ONE_THREAD, code_version

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("-o", "--out", type=Path, default=PROJECT / "build" / "spoilt_drives")
    parser.add_argument("--drive", default="", help="drives whose name holds this text")
    parser.add_argument("--change", default="", help="changes whose name holds this text")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--any-version", action="store_true", help="take older code's cases too")
    parser.add_argument("--report", action="store_true", help="run nothing, print the verdicts")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    results, version = args.out / "results.jsonl", code_version()
    done: dict[tuple[str, str], dict[str, Any]] = {}
    if results.exists():
        for line in results.read_text(encoding="utf-8").splitlines():
            row = json.loads(line)
            if args.any_version or row["version"] == version:
                done[row["drive"], row["change"]] = row["case"]
    changes = [c for c in CHANGES if args.change in c]
    wanted = [(n, c) for n in DRIVES if args.drive in n for c in ["baseline", *changes]]
    if "mounting" in changes:
        # an IMU whose axes nobody stated has another baseline
        wanted += [("rtk-car-a", "baseline of mounting")] if args.drive in "rtk-car-a" else []
    todo = [w for w in wanted if w not in done and not args.report]
    for name in ONE_THREAD:
        os.environ[name] = "1"
    failed = 0
    note: Callable[[str], None] = lambda text: print(text, flush=True)  # noqa: E731
    note(f"{len(todo)} of {len(wanted)} cases to run, code {version}")
    with get_context("spawn").Pool(args.jobs) as pool:
        tasks = [(name, change, args.out / "runs") for name, change in todo]
        for name, change, case in pool.imap_unordered(_one, tasks):
            if isinstance(case, str):
                failed += 1
                note(f"{name} {change} failed: {case}")
                continue
            done[name, change] = case
            row = {"version": version, "drive": name, "change": change, "case": case}
            with results.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
            names = ", ".join(f["effect"] for f in case["findings"]) or "-"
            note(f"{name:<22} {change:<22} {case['cpu_s']:4.0f} s  {names}")
    print("\n".join(report(done)))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.path.insert(0, str(PROJECT))
    sys.exit(main())
