"""Checks of a receiver's velocities against its positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from automap.evaluation.plausibility import Finding, Severity
from automap.gates import sigmas
from automap.records import Fixes
from automap.sync.limits import SOUND_TURN_SD
from automap.sync.velocity_consistency import velocity_consistency
from automap.sync.velocity_findings import Interval, VelocityConsistency, told_intervals
from pipeline.check import limits

ADVICE: dict[str, str] = {
    "velocity_unit": "convert the column, or take the velocities out",
    "velocity_scale": "convert the column, or take the velocities out",
    "course_turned": "courses are clockwise from north, velocities north, east, down: write them "
    "so, or take them out",
    "course_off": "courses are against true north, not against the compass; they are turned back "
    "until then",
    "course_coarse": "log the receiver's own, to a tenth of a degree; velocities are left out "
    "until then",
    "positions_straight": "log the positions of the receiver itself",
    "positions_late": "turn the receiver's smoothing of positions off, or log those that belong to "
    "the times; they are dated back until then",
    "sign_turned": "longitudes are positive east, latitudes north, velocities north, east, down: "
    "give the column its sign",
    "velocity_stuck": "take the velocities of that time out; let the log say where there is none",
    "position_frozen": "take the rows out whose position is not new",
    "rows_frozen": "take the rows out that repeat the one before",
    "vertical_turned": "the third velocity is downwards: change its sign, or take it out",
    "height_held": "leave the column empty where nothing was measured; they count as of three "
    "satellites",
    "height_stuck": "leave the column empty where nothing was measured; heights of path and signs "
    "are unknown then",
    "height_scale": "convert heights to metres; those of path and signs are as wrong until then",
    "vertical_stuck": "leave the column empty where nothing was measured",
}
"""What to do about each reason."""
MIRRORED = "sign_turned"
"""The one that nobody can mend: either the path is mirrored or its velocities are."""
_SWAPPED = Finding(
    "error",
    "latitude and longitude are swapped, or north and east of the velocities",
    "the velocities fit the positions best with latitude and longitude the other way round: swap "
    "the two columns",
    "coordinates_swapped",
)
WHOLE = ("velocity_unit", "velocity_scale", "course_turned", "sign_turned")
"""Reasons that are about all velocities of a log."""


_MINUTES = (
    "look up a position on a map: if it is tens of km off, write positions as degrees with "
    "decimals, 48.2167 for 48 deg 13'; if it is right, convert the column of velocities, or take "
    "them out"
)


def check(fixes: Fixes) -> list[Finding]:
    """What is wrong with the velocities, or how they agree with the positions; nothing where there
    are none."""
    if np.count_nonzero(np.isfinite(fixes.vel_ned[:, :2]).all(axis=1)) < 2:
        return []
    found = velocity_consistency(fixes)
    held = {
        "velocity_stuck": found.velocity_stuck,
        "position_frozen": found.position_frozen,
        "rows_frozen": found.rows_frozen,
    }
    swapped = _swapped(fixes, found)
    findings = [_SWAPPED] if swapped else []
    for reason in found.reasons:
        if swapped and reason.code in WHOLE:
            continue
        severity: Severity = "error" if reason.code == MIRRORED else "warning"
        if reason.code in held and _little(held[reason.code], found.compared_s):
            severity = "info"
        advice = ADVICE[reason.code]
        if reason.code == "velocity_unit" and found.may_be_minutes:
            advice = _MINUTES
        if reason.code in WHOLE and reason.code != MIRRORED:
            advice += "; they are left out until then"
        findings.append(Finding(severity, reason.text, advice, reason.code))
    if found.unrelated and not swapped:
        findings.append(
            Finding(
                "error",
                "velocities and positions have nothing in common",
                "are both of one drive and of one clock? Take the velocities out otherwise",
                "velocity_unrelated",
            )
        )
    elif not swapped and not any(
        reason.code in (*WHOLE, "course_coarse", "positions_late") for reason in found.reasons
    ):
        findings += _agreement(found)
    if found.parted:
        total = sum(interval.seconds for interval in found.parted)
        findings.append(
            Finding(
                "warning" if total > limits.LOST_SHARE * found.compared_s else "info",
                "positions and velocities part by more than either may err: "
                + told_intervals(found.parted),
                "tunnels, bridges and high houses do that; the fusion weighs one with the other",
                "positions_parted",
            )
        )
    return findings


def _swapped(fixes: Fixes, found: VelocityConsistency) -> bool:
    """Whether latitude and longitude are swapped.

    Positions and velocities then agree but for north and east beyond doubt, or not at all; and
    swapping the coordinates mends that, and at least as well as swapping the velocities would:
    the metres of a degree of longitude tell, which depend on latitude.
    """
    crossed = found.match.mirrored and found.match.quarters % 2 == 1
    if not (found.unrelated or crossed):
        return False
    if not np.nanmax(np.abs(fixes.lon_rad), initial=0.0) < 0.5 * np.pi:
        return False
    other = velocity_consistency(replace(fixes, lat_rad=fixes.lon_rad, lon_rad=fixes.lat_rad))
    fits = other.can_tell and not (other.unrelated or other.turned or other.scale_wrong)
    return fits and other.worse <= found.worse


def _little(intervals: Sequence[Interval], compared_s: float) -> bool:
    """Whether no interval is long, nor all of them together."""
    longest = max(interval.seconds for interval in intervals)
    total = sum(interval.seconds for interval in intervals)
    return longest <= limits.FIX_GAP_S and total <= limits.LEFT_OUT_SHARE * compared_s


def _agreement(found: VelocityConsistency) -> list[Finding]:
    """How velocities that are told as they should be agree with the positions."""
    compared = _compared(found)
    if found.means is None:
        return [compared]
    means = Finding(
        "info",
        found.means.text,
        "a run makes the path without it; a receiver's own (Doppler) velocity would help",
        "velocity_of_positions",
    )
    # their lags are those of means
    return [compared, means] if compared.severity == "warning" else [means]


def _compared(found: VelocityConsistency) -> Finding:
    """Scale, delays and turn of the velocities."""
    match = found.match
    if match.scale is None:
        return Finding(
            "info",
            "velocities cannot be compared with the positions: the drive moves too little",
        )
    sure = sigmas(limits.LATE_PROBABILITY)
    parts = [
        f"velocities are {match.scale.value:.3f} times those of the positions "
        f"(sd {match.scale.sd:.1g})"
    ]
    late = -np.inf
    for name, lag in (("speed", match.speed_lag_s), ("course", match.course_lag_s)):
        if lag is not None:
            early = "late" if lag.value >= 0.0 else "early"
            parts.append(f"{name} {abs(lag.value):.2f} s {early} (sd {lag.sd:.1g})")
            late = max(late, abs(lag.value) - sure * lag.sd)
    text = ", ".join(parts)
    if abs(match.scale.value - 1.0) > sure * np.hypot(match.scale.sd, limits.SCALE_SD):
        return Finding("warning", text, "is it the receiver's speed? Wheels and apps err so much")
    turn = match.turn_rad
    off = turn is not None and abs(turn.value) > sure * np.hypot(turn.sd, SOUND_TURN_SD)
    if turn is not None and off and not found.course_off:
        return Finding(
            "warning",
            f"{text}, and courses {np.rad2deg(-turn.value):+.1f} deg off",
            "courses are against true north, not against the compass",
        )
    if late > limits.LATE_S:
        return Finding("warning", text, "is the velocity in the row of its own time?")
    if late > limits.LATE_TOLD_S:
        return Finding("info", text, "such delays are estimated with the trajectory")
    return Finding("ok", text)
