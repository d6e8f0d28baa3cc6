"""Checks of the receiver log and the antenna."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from automap.evaluation.plausibility import Finding
from automap.fusion.limits import LEAST_FIXES, MOST_ARM_M
from automap.io.drive import Drive
from automap.io.receiver_told import manual_positions
from automap.io.recording import Recording
from automap.records import FixType
from automap.timebase import gps_to_iso
from pipeline.check import geoid, limits, position

_VELOCITY = (
    "let the receiver send NAV-PVT, RMC or VTG",
    "give the table columns of speed and course, or of vn and ve; a speed alone serves as a file "
    "of wheel speeds, [odometer]",
)
_HEIGHT = (
    "let the receiver send GGA with the geoid separation, or NAV-PVT",
    "give the table a column of heights, above the ellipsoid or beside the geoid's",
)
"""What to do, for a receiver's log and for a table."""
ABSENT = Finding(
    "error",
    "no receiver log",
    "without GPS nothing can be placed on a map: add gnss.ubx, gnss.nmea or gnss.pos, or a "
    "finished trajectory.csv or trajectory.pos",
    "no_positions",
)

OPEN_SKY = "give the antenna an open sky and wait for a fix before driving"


def has_fix(recording: Recording) -> bool:
    """Whether there is any position at all."""
    fixes = recording.fixes
    return fixes is not None and bool(np.any(fixes.fix_type >= FixType.TWO_D))


def check(drive: Drive, recording: Recording) -> list[Finding]:
    """What the log holds: messages, epochs, quality of the fixes, damage."""
    fixes, log = recording.fixes, recording.log
    assert fixes is not None
    assert log is not None
    most = sorted(log.messages.items(), key=lambda item: -item[1])[:6]
    shown = ", ".join(f"{count} {name}" for name, count in most)
    findings = [Finding("ok", f"{log.kind} log: {shown}")]
    good = fixes.fix_type >= FixType.TWO_D
    manual = manual_positions(log.nmea)
    if not np.any(good) and manual.any():
        text = f"{np.count_nonzero(manual)} positions were typed in by hand, by their quality 7"
        advice = "a receiver's own are 1 to 6; programs of phones write 7 for what they measured"
        return [*findings, Finding("error", text, advice, "gnss_quality")]
    if not np.any(good):
        text = f"the receiver never had a fix in {len(fixes)} epochs"
        return [*findings, Finding("error", text, OPEN_SKY, "no_fix")]
    placed = int(np.count_nonzero(good & np.isfinite(fixes.lat_rad) & np.isfinite(fixes.gps_s)))
    if placed < LEAST_FIXES:
        text = f"{placed} of {len(fixes)} epochs has a time and a place, and a path needs two"
        return [*findings, Finding("error", text, OPEN_SKY, "few_fixes")]
    findings += position.check(fixes, drive.site.country, _written_s(drive.gnss_file))
    findings += geoid.check(fixes)
    findings += _quality(recording, good)
    findings += _jumps(recording, good)
    return findings


def _written_s(file: Path | None) -> float | None:
    """When a file was last written, UNIX time."""
    return None if file is None else file.stat().st_mtime


def _quality(recording: Recording, good: np.ndarray) -> list[Finding]:
    fixes = recording.fixes
    assert fixes is not None
    t = fixes.gps_s[good & np.isfinite(fixes.gps_s)]
    findings = []
    if len(t) > 1:
        step = float(np.median(np.diff(t)))
        rate = 1.0 / step if step > 0 else float("nan")
        text = (
            f"{np.count_nonzero(good)} fixes of {len(fixes)} epochs, {rate:.3g} Hz, "
            f"{gps_to_iso(float(t[0]))} to {gps_to_iso(float(t[-1]))}"
        )
        findings.append(Finding("ok", text))
        gaps = np.diff(t)
        if np.any(gaps > max(limits.FIX_GAP_S, limits.FIX_GAP_STEPS * step)):
            findings.append(
                Finding("info", f"longest time without a fix {float(gaps.max()):.1f} s")
            )
        if np.any(gaps < 0):
            findings.append(
                Finding("warning", "the time of the fixes runs back", "is it one log or several?")
            )
    lost = 1.0 - np.count_nonzero(good) / len(fixes)
    if lost > limits.LOST_SHARE:
        findings.append(
            Finding("warning", f"{100 * lost:.0f} % of the epochs have no fix", "check the antenna")
        )
    is_table = recording.log is not None and recording.log.kind == "table"
    velocity = np.isfinite(fixes.vel_ned[good, :2]).all(axis=1)
    if not velocity.all():
        findings.append(
            Finding(
                "warning",
                f"{np.count_nonzero(~velocity)} fixes without velocity",
                f"{_VELOCITY[is_table]}; velocity carries most of the accuracy",
            )
        )
    height = np.isfinite(fixes.height_m[good])
    if not height.all():
        findings.append(
            Finding(
                "warning",
                f"{np.count_nonzero(~height)} fixes without ellipsoidal height",
                _HEIGHT[is_table],
            )
        )
    if np.any(fixes.fix_type >= FixType.FLOAT):
        findings.append(
            Finding(
                "info",
                "corrected (RTK) positions are in the datum of the correction service "
                "(GDA2020, ETRS89, NAD83 ...), which lies up to 1.4 m off WGS-84",
                "state it when you compare the map with another",
            )
        )
    return findings


def _jumps(recording: Recording, good: np.ndarray) -> list[Finding]:
    from automap.earth import local_ned

    fixes = recording.fixes
    assert fixes is not None
    rows = np.flatnonzero(good & np.isfinite(fixes.lat_rad) & np.isfinite(fixes.gps_s))
    if len(rows) < 2:
        return []
    ref = (float(fixes.lat_rad[rows[0]]), float(fixes.lon_rad[rows[0]]), 0.0)
    position = local_ned(fixes.lat_rad[rows], fixes.lon_rad[rows], np.zeros(len(rows)), ref)
    steps = np.diff(fixes.gps_s[rows])
    moving = steps > 0
    speed = np.linalg.norm(np.diff(position[:, :2], axis=0), axis=1)[moving] / steps[moving]
    wild = int(np.count_nonzero(speed > limits.FASTEST_M_S))
    if not wild:
        return []
    return [
        Finding(
            "warning",
            f"the position jumps {wild} times faster than {limits.FASTEST_M_S:g} m/s",
            "single wild fixes are gated out; many mean a bad antenna place",
        )
    ]


def lever_arms(drive: Drive) -> list[Finding]:
    """Whether the places of the antenna and of the cameras look like ones on a vehicle."""
    road = drive.vehicle.imu_above_road_m
    low = limits.LOW_ARM_M if road is None else road
    found = []
    if drive.gnss_file is not None:
        found += _antenna(drive.gnss.lever_arm_m, min(low, limits.LOW_ARM_M), road)
    for name, video in drive.videos.items():
        found += _odd_arm(f"[video.{name}] ", "camera", video.section.lever_arm_m, low, road)
    return found


def _antenna(arm: tuple[float, ...] | None, low: float, road: float | None) -> list[Finding]:
    if arm is not None:
        well = Finding("ok", f"lever arm {float(np.linalg.norm(arm)):.2f} m")
        return _odd_arm("", "antenna", arm, low, road) or [well]
    text = "lever_arm_m is not given and taken as zero"
    advice = "measure IMU to antenna (forward, right, down) and add it to [gnss]"
    return [Finding("info", text, advice)]


def _odd_arm(
    section: str, what: str, arm: tuple[float, ...], low: float, road: float | None
) -> list[Finding]:
    """A warning of an arm (forward, right, down, m) that is too long, or of what it puts further
    below the IMU than ``low``, where ``road`` m below is the road, None unknown."""
    length = float(np.linalg.norm(arm))
    if length > limits.LONG_ARM_M:
        no_use = what == "antenna" and length > MOST_ARM_M
        left_out = ", more than any vehicle, and is left out" if no_use else ""
        text = f"{section}lever_arm_m is {length:.1f} m long{left_out}"
        advice = f"it is in metres, from IMU to {what}, in the vehicle's forward, right, down"
        return [Finding("warning", text, advice)]
    if arm[2] <= low:
        return []
    advice = f"down is positive: the third number of {what}s above the IMU is negative"
    where = f"{arm[2]:.2f} m below the IMU"
    if road is not None and arm[2] > road:
        where = f"{arm[2] - road:.2f} m under the road"
        advice += f"; or correct imu_above_road_m, {road:g}"
    return [Finding("warning", f"{section}lever_arm_m puts the {what} {where}", advice)]
