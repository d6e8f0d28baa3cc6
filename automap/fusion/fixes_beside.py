"""The path of the fixes alone beside one that an IMU made: what it tells of that, and where it
takes its place."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.errors import InputError
from automap.fusion.doubts import limits, outcome
from automap.fusion.doubts.astray import CODES
from automap.fusion.doubts.path import fix_misses, off_the_fixes
from automap.fusion.doubts.reason import Reason
from automap.fusion.doubts.receiver import dated_velocities
from automap.fusion.doubts.slow_drift import Drift, drifting, pattern_doubts
from automap.fusion.fix_levels import fix_levels
from automap.fusion.gnss_only import as_old_as, as_sure_as_fixes, smooth_fixes
from automap.fusion.judged import Judged
from automap.fusion.limits import UNKNOWN_HEADING_SD
from automap.fusion.nodes import FixModel
from automap.fusion.receiver_evidence import ReceiverEvidence
from automap.fusion.unread import joined, later, unread
from automap.fusion.verdict_alone import at_sensor
from automap.fusion.weighed import Weighed, weighed_path
from automap.fusion.widening import widen
from automap.records import Fixes, FloatArray, Trajectory


@dataclass(frozen=True)
class FixesAlone:
    """The ``path`` of the fixes alone, by errors of the sizes ``levels``; the ``reasons`` and
    ``drifts`` of positions that it shows."""

    path: Trajectory
    levels: Mapping[str, float]
    reasons: list[Reason]
    drifts: list[Drift]


def fixes_alone(
    drive: Judged, beside: ReceiverEvidence, sd_m: float, path: Trajectory | None
) -> FixesAlone | None:
    """The path of the fixes but where the IMU leads over them; the fused one is good to ``sd_m`` m
    an axis, and ``path`` where its IMU is believed."""
    by_imu = () if path is None else (path, drive.result.noise_factors)
    try:
        dated = dated_velocities(beside.witnesses, drive.receiver)
        levels = fix_levels(dated, drive.options)
        alone = _smoothed(drive, dated, levels)
        reasons, drifts = pattern_doubts(
            dated, alone, drive.options, levels, sd_m, beside.reasons, *by_imu
        )
    except InputError:
        return None
    return FixesAlone(alone, levels, reasons, drifts)


def _smoothed(drive: Judged, dated: Fixes, levels: Mapping[str, float]) -> Trajectory:
    alone = smooth_fixes(dated, drive.clock, drive.options, levels)
    shift = round(drive.result.delay.mean * 1e9) if drive.delay_is_clock else 0
    return replace(alone, t_ns=alone.t_ns + shift)


def in_its_place(
    drive: Judged,
    beside: ReceiverEvidence,
    alone: FixesAlone,
    model: FixModel,
    share: float,
    path: Trajectory,
    reasons: Sequence[Reason],
    sliding: Sequence[Reason],
) -> Weighed | None:
    """The path of the fixes in the place of the fused ``path``, which contradicts them over a
    ``share`` of the drive and for ``reasons``, of which those of ``sliding``; None where they
    contradict their own path, too. ``model`` has them with errors as large as they showed."""
    by_fixes, misses = alone.path, fix_misses(alone.path, model)
    own, left = off_the_fixes(misses, drive.options.wander_tau_s)
    if left >= limits.AGREEING_SHARE:
        return None
    of_receiver = [*beside.reasons, *alone.reasons]
    if beside.over:
        # what such an IMU leads over it tells nothing of
        by_fixes = _smoothed(drive, dated_velocities(drive.fixes, drive.receiver), alone.levels)
        misses = fix_misses(by_fixes, model)
        of_receiver, reasons = (
            [*beside.contradictions, *(reason for reason in told if reason.code not in CODES)]
            for told in (of_receiver, reasons)
        )
    # what speaks against the IMU's path leaves that of the fixes as it is
    earlier = float(path.gps_s[0] - by_fixes.gps_s[0])
    of_fixes = [*later(of_receiver, earlier), *own]
    rest = _off_nose(widen(_as_sure(drive, alone, by_fixes), of_fixes, misses, None), sliding)
    reasons = later([outcome.inertial_worse(share), *reasons], earlier)
    moved = at_sensor(drifting(rest, alone.drifts), drive.lever_arm)
    return weighed_path(lambda: iter([moved]), reasons, alone=True)


def between_readings(
    drive: Judged,
    beside: ReceiverEvidence,
    alone: FixesAlone,
    model: FixModel,
    arm: FloatArray,
    path: Trajectory,
    run: Callable[[], Iterator[Trajectory]],
    reasons: Sequence[Reason],
) -> Weighed:
    """The path that ``run`` makes, of the rows of the fused ``path``, weighed by ``reasons``; the
    rows of that of the fixes, whose antenna is at ``arm`` [3] m, are where nothing was read."""
    if not len(unread(alone.path, path.t_ns)):
        return weighed_path(run, reasons, False)
    earlier = float(path.gps_s[0] - alone.path.gps_s[0])
    of_receiver = later([*beside.reasons, *alone.reasons], earlier)
    misses = fix_misses(alone.path, model)
    rest = widen(_as_sure(drive, alone, alone.path), of_receiver, misses, None)
    rest = unread(at_sensor(drifting(rest, alone.drifts), arm), path.t_ns)
    reasons = later(reasons, max(float(path.gps_s[0] - rest.gps_s[0]), 0.0))
    return weighed_path(lambda: joined(run(), rest), reasons, False)


def _as_sure(drive: Judged, alone: FixesAlone, path: Trajectory) -> Trajectory:
    """A path of the fixes no surer than these are, of an instant no surer than their ages."""
    sure = as_sure_as_fixes(path, drive.fixes, drive.options, alone.levels)
    return as_old_as(sure, drive.old_s)


def _off_nose(path: Trajectory, sliding: Sequence[Reason]) -> Trajectory:
    """A path with courses for headings, which are no better than the nose of one that slides."""
    factor = max((reason.factor for reason in sliding), default=1.0)
    return replace(path, sd_rpy=np.minimum(path.sd_rpy * factor, UNKNOWN_HEADING_SD))
