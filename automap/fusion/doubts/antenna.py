"""Where a drive has the antenna, held against where it was said to be."""

from __future__ import annotations

import math

import numpy as np

from automap.fusion.delay_states import COURSE_STATE, VEL_LAG_STATE, VEL_LATENCY_STATE
from automap.fusion.doubts import limits
from automap.fusion.doubts.estimates import Estimates, of_axes, velocity_lead
from automap.fusion.doubts.reason import Reason
from automap.fusion.doubts.receiver import told_late
from automap.fusion.limits import DOUBT_PROBABILITY, HELD_ARM_SD_M, MOST_ARM_M
from automap.gates import exceeds, sigmas
from automap.records import FloatArray
from automap.sync.path_match import Match

_ROWS = 1 << 18
"""Of a path that are looked at at once: 45 minutes at 100 Hz."""


def bend_speed(t: FloatArray, yaw: FloatArray, speed: FloatArray) -> float:
    """The speed, m/s, of the bends that tell an arm: of speeds [n] m/s at ``t`` [n] s, by the
    squared turn rate of the heading ``yaw`` [n] rad, as least squares weigh them."""
    total, moment = 0.0, 0.0
    # what is made of ten hours has no room beside their path
    for a in range(0, len(t) if len(t) > 1 else 0, _ROWS):
        first, stop = max(a - 1, 0), min(a + _ROWS, len(t))
        turn = np.gradient(np.unwrap(yaw[first : stop + 1]), t[first : stop + 1])
        weight = turn[a - first : stop - first] ** 2
        total += float(weight.sum())
        moment += float(weight @ speed[a:stop])
    return moment / total if total > 0.0 else float(speed.max(initial=0.0))


def arm_by_drive(
    found: Estimates, stated: FloatArray | None, stated_sd: float, speed: float
) -> FloatArray | None:
    """The arm [3] m of the antenna by the drive itself where it contradicts that ``stated`` [3] m
    with a sigma of each; None where it does not.

    A right statement and what the drive makes of it differ by no more than the sigma that the drive
    took from it. The drive by itself has it as much further as the statement held it back. In bends
    at ``speed`` m/s an arm looks like a course that is late by the arm over the speed, and
    receivers that are late are so by differing times: an arm is told beyond all of their age.
    """
    if stated is None:
        return None
    own = _drawn_to(found, stated, stated_sd)
    # bends tell the level arm; the upright one moves with whatever a receiver's filter does
    far = float(np.hypot(*(own - stated)[:2]))
    return own if far > limits.ARM_OFF_M + _velocity_lag(found) * speed else None


def _drawn_to(found: Estimates, stated: FloatArray, stated_sd: float) -> FloatArray:
    """The arm [3] m that the drive alone has on axes where no chance draws it so far from
    ``stated`` [3] m, which it has on others."""
    own = np.array(stated, np.float64)
    for k, axis in enumerate("xyz"):
        estimate, sd = found.get(f"gnss_lever_arm_{axis}", (float(stated[k]), stated_sd))
        off = estimate - float(stated[k])
        # of a prior that is looser than the tape the estimate is the drive's own
        taken = stated_sd**2 - sd**2 if sd < stated_sd else stated_sd**2
        if abs(off) > sigmas(DOUBT_PROBABILITY) * math.sqrt(taken):
            own[k] += float(np.clip(off * stated_sd**2 / taken, -MOST_ARM_M, MOST_ARM_M))
    return own


def _velocity_lag(found: Estimates, *more: str) -> float:
    """How late velocities are, s, and by the states ``more``."""
    names = (VEL_LATENCY_STATE, VEL_LAG_STATE, *more)
    return abs(sum(found.get(name, (0.0, 0.0))[0] for name in names))


def contradicted_arm(
    found: Estimates, stated: FloatArray | None, stated_sd: float, speed: float
) -> list[Reason]:
    """An arm of the antenna, as in ``arm_by_drive``, that the drive moves away from; or by less, as
    receivers' filters make it, which the path has followed all the same."""
    if stated is None:
        return []
    own = arm_by_drive(found, stated, stated_sd, speed)
    if own is None:
        drawn = (_drawn_to(found, stated, stated_sd) != stated)[:2]
        off = float(np.hypot(*np.where(drawn, (of_axes(found, "gnss_lever_arm") - stated)[:2], 0)))
        return (
            []
            if not off
            else [
                Reason(
                    "lever_arm",
                    f"the drive draws the antenna {off:.2f} m from lever_arm_m of [gnss], as a "
                    "receiver's filter does too: the stated uncertainty includes it; log "
                    "velocities of an instant, or measure again",
                    error_m=off,
                    state="good",
                )
            ]
        )
    off = float(np.linalg.norm(own - stated))
    return [
        Reason(
            "lever_arm",
            f"the drive puts the antenna {off:.1f} m or more from lever_arm_m of [gnss], near "
            f"[{', '.join(f'{value:.1f}' for value in own)}]: measure again from the IMU forward, "
            "right and down (an antenna on the roof has a negative third number), or take the "
            "line out",
            error_m=off,
        )
    ]


def misplaced_antenna(found: Estimates, own: Match, speed: float) -> list[Reason]:
    """An antenna that is behind where it was taken to be, as on a trailer, or ahead of it, by how
    it turns; bends at ``speed`` m/s.

    A receiver's filter that dates courses otherwise than speeds, or velocities otherwise than
    positions, does so within its own, which ``own`` tells, by lags that differ from bend to bend.
    Where it shows none an antenna that is behind comes later to bends than the IMU, courses and
    positions alike, and speeds do not. How far behind is told by the point that does not slide,
    too, which cars do not have ahead of the IMU.
    """
    lags = own.speed_lag_s, own.course_lag_s
    if lags[0] is None or lags[1] is None or any(told_late(lag) for lag in lags):
        return []
    lead, lead_sd = velocity_lead(found)
    late, sd = found.get(COURSE_STATE, (0.0, math.inf))
    lead, lead_sd = lead + lags[0].value, math.hypot(lead_sd, lags[0].sd)
    late, sd = late - lags[1].value + lags[0].value, math.hypot(sd, lags[0].sd, lags[1].sd)
    chance = exceeds((late / sd) ** 2 + (lead / lead_sd) ** 2, 2)
    if late * lead <= 0.0 or chance > limits.UNHELD_PROBABILITY:
        return []
    far = abs(late) * speed
    if late > 0.0:
        far += max(found.get("nhc_lever_arm_x", (0.0, 0.0))[0], 0.0)
    where = "behind where it was taken to be, on a trailer or at the tail of a bus,"
    return [
        Reason(
            "lever_arm",
            "the receiver's positions and velocities agree with each other, and both come to bends "
            f"{abs(late):.2f} s {'later' if late > 0.0 else 'earlier'} than the IMU, though they "
            f"gain speed with it: as an antenna some {far:.0f} m "
            f"{where if late > 0.0 else 'ahead of where it was taken to be,'} and path and signs "
            "are as far off along the road; measure lever_arm_m of [gnss] from the IMU forward, "
            "right and down",
            error_m=far,
            state="doubtful" if chance < DOUBT_PROBABILITY else "good",
        )
    ]


def overturned_arm(found: Estimates, stated: FloatArray | None, stated_sd: float) -> list[Reason]:
    """The height of an antenna that was ``stated`` [3] m with the wrong sign, by how it sways.

    The filter holds it, and only asks how far the drive would move it. Receivers' filters take from
    the sway: the drive alone has the antenna between where it is and the IMU, or a bit beyond that
    where they lag, and phones' errors put it metres off (4 m, six sigmas, on a recorded one). So it
    is told where it is found nearer to the other sign than to the IMU, or to twice as far.
    """
    value, sd = found.get("gnss_lever_arm_z", (0.0, math.inf))
    held = stated_sd <= sd < math.inf
    before = HELD_ARM_SD_M if held else stated_sd
    taken = before**2 - sd**2 + (stated_sd**2 if held else 0.0)
    if stated is None or taken <= 0.0 or 2.0 * abs(stated[2]) < limits.ARM_OFF_M:
        return []
    size = abs(float(stated[2]))
    # of the drive alone, how far on the other side
    own = (stated[2] - value) * np.sign(stated[2]) * before**2 / taken - size
    sure = sigmas(DOUBT_PROBABILITY) * before**2 / math.sqrt(taken)
    if not max(sure, 0.5 * size) < own < 1.5 * size:
        return []
    return [
        Reason(
            "lever_arm",
            f"lever_arm_m of [gnss] has the antenna {size:.1f} m "
            f"{'below' if stated[2] > 0.0 else 'above'} the IMU, and it sways as one on the other "
            "side of it does: its third number has the wrong sign (down is positive, an antenna on "
            f"the roof has a negative one), and path and signs are {2.0 * size:.1f} m too "
            f"{'high' if stated[2] > 0.0 else 'low'}",
            height_m=2.0 * size,
        )
    ]


def unproven_arm(
    found: Estimates, stated: FloatArray | None, stated_sd: float, speed: float, sd_m: float
) -> list[Reason]:
    """A level arm, as in ``arm_by_drive``, that with the wrong sign would not be told, where that
    is more than what the path is good to anyway, ``sd_m`` m an axis."""
    if stated is None:
        return []
    twice = 2.0 * np.abs(stated[:2])
    sd = np.array([found.get(f"gnss_lever_arm_{a}", (0.0, stated_sd))[1] for a in "xy"])
    taken = np.maximum(stated_sd**2 - sd**2, 0.0)
    seen = twice * np.sqrt(taken) > sigmas(DOUBT_PROBABILITY) * stated_sd**2
    # an arm looks like an age of the course, which may be another than the speed's
    lag = max(_velocity_lag(found), _velocity_lag(found, COURSE_STATE))
    seen &= twice > limits.ARM_OFF_M + lag * speed
    hidden = twice[~seen & (twice > max(limits.ARM_OFF_M, sd_m))]
    if not len(hidden):
        return []
    return [
        Reason(
            "lever_arm_unproven",
            "nothing in the drive shows whether lever_arm_m of [gnss] has the right signs: with a "
            f"wrong one path and signs would be {hidden.max():.1f} m off. In its bends, at "
            f"{speed:.0f} m/s, an arm looks like a receiver's delay; turn once at walking pace, or "
            "measure again from the IMU forward, right and down",
            state="good",
            handled=True,
        )
    ]
