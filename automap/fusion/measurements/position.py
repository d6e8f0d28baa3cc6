"""The position of the antenna, from a fix."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from automap.effects.measured_kernels import antenna_position
from automap.fusion.arrays import ModelArrays, NodeArrays
from automap.fusion.layout import CH_POS, HAS_POS_H, HAS_POS_V
from automap.fusion.limits import (
    ACCURACY_HELD,
    DOWN_FACTOR,
    FIX_AGE_SD_S,
    JITTER_FIXES,
    JITTER_SIGMAS,
    LEAST_WHITE_M,
    MOST_JITTER,
    UNKNOWN_HDOP,
    UNSTATED_SD_M,
)
from automap.fusion.measurements.state import AtNode
from automap.fusion.mechanisation import radii
from automap.fusion.options import FusionOptions
from automap.jit import kernel
from automap.records import BoolArray, ClockModel, Fixes, FixType, FloatArray
from automap.sync.digits import rounded_m

CORRECTED = (FixType.DGNSS, FixType.FLOAT, FixType.FIXED)
"""Fixes whose receiver was told what satellites have in common."""
_STEP_SHARE, _STEP_SIGMAS = 0.9, 1.645 * math.sqrt(2.0)
"""This share of the differences of two normal numbers is less than so many of their sigmas. Chosen:
the median of those of a receiver that tells each figure twice is none, and rare changes stay."""


def position_errors(
    fixes: Fixes, factor: FloatArray, options: FusionOptions
) -> tuple[FloatArray, FloatArray]:
    """Sigma NED [n, 3] m of the whole error of positions, and of its white part.

    The receiver's accuracy figure, times ``factor`` [n], is taken as the size of its slowly
    wandering error; its white part is a share of that, and what digits cut off. Carrier-phase
    solutions are short-term as good as they say. Without a figure: HDOP times a consumer receiver's
    range error, and what geometry does not thin out (Kaplan and Hegarty, Understanding GPS, section
    7.2), but no less than data sheets state; of carrier phases that alone.
    """
    hdop = np.where((fixes.hdop > 0) & (fixes.hdop < UNKNOWN_HDOP), fixes.hdop, 1.0)
    carrier = (fixes.fix_type == FixType.FIXED) | (fixes.fix_type == FixType.FLOAT)
    least = _unstated(fixes)
    horizontal = np.hypot(options.horizontal_sd_m * hdop, options.common_horizontal_sd_m)
    vertical = np.hypot(options.vertical_sd_m * hdop, options.common_vertical_sd_m)
    horizontal = np.where(carrier, least, np.maximum(horizontal, least))
    vertical = np.where(carrier, DOWN_FACTOR * least, vertical)
    fallback = np.stack([horizontal, horizontal, vertical], axis=1)
    stated = np.isfinite(fixes.sd_pos_ned) & (fixes.sd_pos_ned > 0)
    sd = np.where(stated, fixes.sd_pos_ned, fallback)
    sd = np.maximum(sd * factor[:, None], options.min_position_sd_m)
    white = np.where(carrier[:, None], sd, np.maximum(options.white_share * sd, LEAST_WHITE_M))
    white[:, :2] = np.hypot(white[:, :2], rounded_m(fixes))
    return sd, white


def hold_reported_sd(sd: FloatArray) -> FloatArray:
    """Accuracy figures [m, 3] that follow real changes and not the jitter of the reports.

    A figure is held until the reported one differs by a quarter. Where reports scatter by more from
    one fix to the next, the middle of some is held until one lies outside of that scatter.
    """
    if len(sd) == 0:
        return sd
    out = np.empty_like(sd)
    for axis in range(sd.shape[1]):
        log = np.log(sd[:, axis])
        steps = np.abs(np.diff(log))
        scatter = float(np.quantile(steps, _STEP_SHARE)) / _STEP_SIGMAS if len(steps) else 0.0
        away_from = min(JITTER_SIGMAS * scatter, MOST_JITTER)
        jitters = away_from > ACCURACY_HELD
        away_from = max(away_from, ACCURACY_HELD)
        held = log.copy()
        start = 0
        while start < len(log):
            level = log[start]
            if jitters:
                middle = np.median(log[start : start + JITTER_FIXES])
                level = middle if abs(level - middle) <= away_from else level
            away = np.flatnonzero(np.abs(log[start:] - level) > away_from)
            stop = start + int(away[0]) if len(away) else len(log)
            held[start:stop] = level
            start = stop
        out[:, axis] = np.exp(held)
    return out


def states_accuracy(fixes: Fixes, options: FusionOptions) -> BoolArray:
    """Which positions [n, 3] state an accuracy that they can have: without corrections none is
    surer than what satellites have in common."""
    stated = np.asarray(np.isfinite(fixes.sd_pos_ned) & (fixes.sd_pos_ned > 0))
    level = np.hypot(fixes.sd_pos_ned[:, 0], fixes.sd_pos_ned[:, 1])
    believed = np.isin(fixes.fix_type, CORRECTED)
    believed |= ~(level < math.sqrt(2.0) * options.common_horizontal_sd_m)
    return stated & believed[:, None]


def _unstated(fixes: Fixes) -> FloatArray:
    """Least sigma [n] m an axis of positions that state none."""
    least = np.full(len(fixes), UNSTATED_SD_M[FixType.THREE_D])
    for fix_type, value in UNSTATED_SD_M.items():
        least[fixes.fix_type == fix_type] = value
    return least


def lasting_share(
    options: FusionOptions, factors: Mapping[str, float], larger: float = 1.0
) -> FloatArray:
    """Sigma NED [3] of the errors that last for seconds and minutes, as a share of the accuracy
    that fixes state; ``factors`` on their sizes by level, 1 for one that is missing, and by how
    much those of seconds are ``larger``."""
    slow, quick = _lasting(options, factors)
    return np.hypot(slow, quick * larger)


def _lasting(options: FusionOptions, factors: Mapping[str, float]) -> tuple[FloatArray, float]:
    level, down = (factors.get(name, 1.0) for name in ("wander", "wander_v"))
    quick = options.multipath_share * factors.get("multipath", 1.0)
    return options.wander_share * np.array([level, level, down]), quick


def quick_factor(times: float, options: FusionOptions) -> float:
    """By how much errors of seconds are larger where positions change ``times`` as much from one
    half of such an error to the next, and errors of minutes are as ever."""
    if options.multipath_share == 0.0:
        return times
    step = 0.5 * options.multipath_tau_s
    changes = math.expm1(-step / options.wander_tau_s) / math.expm1(-0.5)
    slow = (options.wander_share / options.multipath_share) ** 2 * changes
    return math.sqrt(times**2 + (times**2 - 1.0) * slow)


def unseen_errors(
    stated_sd: FloatArray, options: FusionOptions, factors: Mapping[str, float]
) -> FloatArray:
    """Sigma NED [n, 3] m of the part of positions' errors that outlasts what motion can tell.

    A constant, or what changes over an hour, moves fixes and path alike: no innovation shows it,
    so nothing here may take it away. It is ``bias_share`` of the ``stated_sd`` [n, 3], and what of
    the other shares does not show: an error that is as large as was stated, and shows less, lasts.
    Errors of minutes and of hours have one cause, and grow together by the ``factors`` on what
    does show. White and quick errors beyond their shares are no part of what was stated, and leave
    as much. Heights are of the ranges that positions are of: where those err by more than was
    stated, heights err with them, however smooth they are. Positions need not err as heights do,
    which the air delays.
    """
    left, _ = _unseen_shares(options, factors)
    return stated_sd * np.sqrt(left)


def unseen_changes(
    stated_sd: FloatArray, seconds: float, options: FusionOptions, factors: Mapping[str, float]
) -> FloatArray:
    """Sigma NED [n, 3] m by which ``unseen_errors`` differ after ``seconds``: all but the constant
    part, which is ``bias_share``, lasts as slow errors do."""
    left, constant = _unseen_shares(options, factors)
    gone = -2.0 * math.expm1(-seconds / options.wander_tau_s)
    return stated_sd * np.sqrt(gone * (left - constant))


def _unseen_shares(
    options: FusionOptions, factors: Mapping[str, float]
) -> tuple[FloatArray, FloatArray]:
    """Variances NED [3] of unseen errors over those stated, and of their constant part."""
    slow, quick = _lasting(options, factors)
    level, down = (min(factors.get(name, 1.0), 1.0) for name in ("position_h", "position_v"))
    white = options.white_share * np.array([level, level, down])
    shown = slow**2 + min(quick, options.multipath_share) ** 2 + white**2
    grown = np.maximum(np.maximum.accumulate(slow) / options.wander_share, 1.0)
    lasts = grown * math.hypot(options.wander_share, options.bias_share)
    left = lasts**2 + options.multipath_share**2 + options.white_share**2 - shown
    return left, np.minimum((grown * options.bias_share) ** 2, left)


def common_errors(fixes: Fixes, options: FusionOptions) -> FloatArray:
    """Sigma NED [n, 3] m below which no fix is known that was made without corrections, whatever
    its receiver states: orbits and clocks of the satellites and the air are the same for minutes,
    and nothing in the drive shows them. Zero for corrected ones that state what they are good to;
    one that does not is no surer than any of its kind."""
    common = np.where(np.isin(fixes.fix_type, CORRECTED), 0.0, options.common_horizontal_sd_m)
    level = states_accuracy(fixes, options)[:, :2].all(axis=1)
    common = np.where(level, common, np.maximum(common, _unstated(fixes)))
    return np.asarray(common[:, None] * np.array([1.0, 1.0, DOWN_FACTOR]))


def has_position(fixes: Fixes) -> tuple[BoolArray, BoolArray]:
    """Which fixes [n] have a horizontal position, and which a height."""
    kind = fixes.fix_type
    level = np.isfinite(fixes.lat_rad) & np.isfinite(fixes.lon_rad) & (kind > FixType.NONE)
    return level, level & np.isfinite(fixes.height_m) & (kind != FixType.TWO_D)


def carrier_sd(fixes: Fixes) -> FloatArray:
    """Level sigma [n] m an axis of carrier-phase positions, short-term too; of others infinite."""
    carrier = (fixes.fix_type == FixType.FIXED) | (fixes.fix_type == FixType.FLOAT)
    stated = fixes.sd_pos_ned[:, :2].max(axis=1)
    sd = np.where(np.isfinite(stated) & (stated > 0.0), stated, _unstated(fixes))
    return np.where(carrier & has_position(fixes)[0], sd, np.inf)


def by_carrier(fixes: Fixes) -> bool:
    """Whether most positions are carrier-phase solutions, which are of the instant of their tag,
    while a navigation filter's own may be of one a little before or after."""
    kind = fixes.fix_type[fixes.fix_type > FixType.NONE]
    carrier = (kind == FixType.FIXED) | (kind == FixType.FLOAT)
    return bool(np.count_nonzero(carrier) > 0.5 * len(kind))


def age_sd_of(fixes: Fixes, clock: ClockModel, options: FusionOptions) -> float:
    """Sigma, s, of what dates all fixes of a drive wrong: their age, and the clock between them and
    the stamps."""
    known = "gnss_latency" in options.fixed or by_carrier(fixes)
    return math.hypot(0.0 if known else FIX_AGE_SD_S, min(clock.sd_offset_s, 1.0))


@kernel
def position(
    nodes: NodeArrays, k: int, at: AtNode, model: ModelArrays, h: FloatArray, z: FloatArray
) -> tuple[int, int]:
    """Residual ``z`` [3] m NED and rows ``h`` [3, n]: number of rows, first channel (loosely
    coupled: Groves, section 14.3)."""
    flags, fix, pos = nodes.flags[k], nodes.fix[k], at.pos
    horizontal, vertical = (flags & HAS_POS_H) != 0, (flags & HAS_POS_V) != 0
    if not (horizontal or vertical):
        return 0, 0
    terms, params, signals, room = model.on_position, at.params, at.signals, at.room
    antenna_position(h, z, at.vel, at.c, at.rate, params, terms.codes, terms.weights, signals, room)
    rm, rn = radii(pos[0])
    dlon = fix[1] - pos[1]
    if dlon > math.pi:
        dlon -= 2 * math.pi
    elif dlon < -math.pi:
        dlon += 2 * math.pi
    z[0] = (fix[0] - pos[0]) * (rm + pos[2]) - z[0]
    z[1] = dlon * (rn + pos[2]) * math.cos(pos[0]) - z[1]
    z[2] = -(fix[2] - pos[2]) - z[2]
    if horizontal:
        return (3 if vertical else 2), CH_POS
    z[0] = z[2]
    h[0, :] = h[2, :]
    return 1, CH_POS + 2
