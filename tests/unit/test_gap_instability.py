"""What acts under a condition only, and shows nothing on the whole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from automap.gap import base_model, limits
from automap.gap.beside import Beside
from automap.gap.candidates import candidates_of, formula_column
from automap.gap.drive import GapDrive, open_drive
from automap.gap.fit import Fit, fit_drive
from automap.gap.instability import unstable
from automap.gap.linear import Column, NodeMotion, linearised
from automap.gap.misfit import WHEN, Misfit
from automap.gap.motion import Motion
from automap.gap.selection import Chosen, Selection
from tests.unit.test_gap import simulated

TERMS = (("velocity_across", "speed"), ("gyro_z", "rate_z"), ("accel_x", "force_x"))


def columns(fit: Fit, motion: Motion, at: NodeMotion, names: object = None) -> list[Column]:
    """A few formulas, whatever their names."""
    return [formula_column(term, at) for term in TERMS]


def told(drive: GapDrive, held_out: GapDrive) -> tuple[Misfit, ...]:
    model = base_model()
    fit, other = (fit_drive(open_drive(d, model.options), model) for d in (drive, held_out))
    linear = linearised([fit], columns, {}, may_act=False)
    selection = Selection(linear, {c.name: c for c in candidates_of(linear.layout, [])})
    asked = Beside(selection, Chosen(), lambda *about: [], {})
    return unstable(selection, Chosen(), [fit], asked, columns, [other])


def hanging(drive: GapDrive, size: float) -> GapDrive:
    """The drive with courses of the fixes that lie off by ``size``, rad, to the side that the car
    turned away from last."""
    fixes = drive.fixes
    course = np.unwrap(np.arctan2(fixes.vel_ned[:, 1], fixes.vel_ned[:, 0]))
    at, off = float(course[0]), np.empty_like(course)
    moves = np.hypot(fixes.vel_ned[:, 0], fixes.vel_ned[:, 1]) > 2.0
    value = at
    for i, here in enumerate(course.tolist()):
        # at rest a course is noise
        value = here if moves[i] else value
        at = min(max(at, value - 0.1), value + 0.1)
        off[i] = np.sign(at - value)
    turn = size * off
    north, east = fixes.vel_ned[:, 0], fixes.vel_ned[:, 1]
    vel = fixes.vel_ned.copy()
    vel[:, 0], vel[:, 1] = north - turn * east, east + turn * north
    return replace(drive, fixes=replace(fixes, vel_ned=vel))


def test_nothing_is_told_where_nothing_is_missing() -> None:
    assert told(simulated({}), simulated({}, seed=8)) == ()


def test_a_course_that_hangs_behind_is_told_where_it_is() -> None:
    drive, held_out = (hanging(simulated({}, seed=s), 0.08) for s in (1, 8))
    (one,) = told(drive, held_out)
    assert one.kind == WHEN
    assert one.where.startswith(f"velocity_across += k * speed {WHEN} ")
    assert one.p_value <= np.exp(-limits.LEAST_ODDS)
    assert "in a size that changes" in str(one)
    # a drive that was held out does not have it
    assert told(drive, simulated({}, seed=8)) == ()
