"""The motion of a fit at its nodes, and what is asked of it there by the columns of candidates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from automap.effects.signals import Signals, signals_of
from automap.effects.user import towards, turned
from automap.frames import quat_to_matrix
from automap.fusion.problem import LateChange
from automap.gap.fit import Fit
from automap.gap.motion import Motion, Then, at_times, late_change, motion_of, then_of
from automap.records import FloatArray

COMPARED_S = 0.1
"""Signals are compared at such times: what a car does hardly changes in between."""


@dataclass(frozen=True)
class NodeMotion:
    """The motion at the nodes of a ``fit``: velocity, acceleration NED, ``dcm`` body to NED, rate
    in body axes without the noise of single readings; ``signals`` the quantities of formulas there,
    ``along`` these, and ``motion``, at the epochs of the IMU; ``units`` of effects what a unit of
    each parameter adds to the channels [k, 15], and what effects of the library but some have
    ``said`` of readings, where that was asked before."""

    fit: Fit
    motion: Motion
    t: FloatArray
    vel: FloatArray
    acc: FloatArray
    dcm: FloatArray
    rate: FloatArray
    signals: Signals
    along: Signals
    units: dict[str, dict[str, FloatArray]] = field(default_factory=dict)
    said: dict[frozenset[str], dict[str, FloatArray]] = field(default_factory=dict)

    @cached_property
    def late(self) -> LateChange | None:
        """By how much late velocities change otherwise than those at their tag."""
        return late_change(self.motion, self.motion.acc, self.fit.delays)

    @cached_property
    def then(self) -> Then:
        """Which instants the velocities with a tag at each epoch are of."""
        return then_of(self.motion, self.fit.delays)

    @cached_property
    def every(self) -> int:
        """Of so many readings one is looked at where signals are compared."""
        return max(round(COMPARED_S / max(float(np.median(np.diff(self.motion.t))), 1e-4)), 1)

    @cached_property
    def late_readings(self) -> dict[str, FloatArray]:
        """What readings show more [n] for each second that their stamps are late, by the names of
        what they change by."""
        ones = np.ones(len(self.along.time))
        parts = [part.turned for part in towards("imu_time")]
        return {part: turned(ones, part, self.along) for part in parts}

    def there(self, values: FloatArray) -> FloatArray:
        """What is known along the drive [n] at the nodes [k], as the filter takes it: a formula may
        remember what was in between."""
        return np.interp(self.signals.time, self.along.time, values)


def node_motion(fit: Fit, motion: Motion) -> NodeMotion:
    """The smoothed motion at the nodes of a fit."""
    nominal = fit.last.smooth.nominal
    t = fit.last.nodes.t
    rate = at_times(motion, motion.calm, t)
    acc = at_times(motion, motion.acc, t)
    along = motion_signals(fit, motion)
    signals, dcm = along.at(t + fit.opened.drive.begin_s), quat_to_matrix(nominal[:, 6:10])
    return NodeMotion(fit, motion, t, nominal[:, 3:6].copy(), acc, dcm, rate, signals, along)


def motions_of(fits: Sequence[Fit]) -> list[NodeMotion]:
    """The smoothed motion of each fit."""
    return [node_motion(fit, motion_of(fit.last)) for fit in fits]


def motion_signals(fit: Fit, motion: Motion) -> Signals:
    """Quantities [n] at the epochs of the motion."""
    drive = fit.opened.drive
    heading = np.unwrap(np.arctan2(motion.dcm[:, 1, 0], motion.dcm[:, 0, 0]))
    along = np.einsum("ni,ni->n", motion.dcm[:, :, 0], motion.acc)
    time = motion.t + drive.begin_s
    temp = drive.imu.temp_c
    return signals_of(time, motion.vel, heading, along, motion.rate, motion.force, temp)
