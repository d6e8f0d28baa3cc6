"""Users' effects in the filter: their signals along a drive, and fixes without them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from automap.earth import metres_per_radian
from automap.effects import Signals
from automap.effects.imu import OF_USER
from automap.effects.signals import signals_of_readings
from automap.effects.user_fixes import acts_on_fixes, fix_errors
from automap.fusion.layout import HAS_VEL_H
from automap.fusion.measurements import FixModel
from automap.fusion.model import StateModel
from automap.records import FloatArray

if TYPE_CHECKING:
    from automap.fusion.passes import Session


def session_signals(session: Session) -> Signals:
    """The quantities of a drive at its IMU samples, as readings and fixes show them."""
    imu, fixes = session.imu, session.fixes
    t = np.asarray((imu.t_ns - imu.t_ns[0]) * 1e-9) + session.begin_s
    has = (fixes.flags & HAS_VEL_H) > 0
    fix_t, velocity = fixes.t[has] + session.begin_s, fixes.values[has, 3:6]
    return signals_of_readings(t, imu.gyro, imu.accel, imu.temp_c, fix_t, velocity)


def signals_for(session: Session, model: StateModel) -> Signals | None:
    """The quantities where an effect of the model is a user's, else None."""
    if any(OF_USER in (t.extra or "") for t in model.terms):
        return session_signals(session)
    return None


def without_known(session: Session) -> Session:
    """The session with its fixes freed of users' effects whose values are given."""
    fixed = session.options.fixed
    if not any(acts_on_fixes(e) for e in fixed):
        return session
    fixes = session.fixes
    signals = session_signals(session).at(fixes.t + session.begin_s)
    position, velocity = fix_errors(fixed, signals)
    return replace(session, fixes=moved_fixes(fixes, -position, -velocity))


def moved_fixes(fixes: FixModel, position: FloatArray, velocity: FloatArray) -> FixModel:
    """Fixes with something added: metres and m/s, NED [m, 3]."""
    values = fixes.values.copy()
    north, east = metres_per_radian(values[:, 0], values[:, 2])
    values[:, 0] += position[:, 0] / north
    values[:, 1] += position[:, 1] / east
    values[:, 2] -= position[:, 2]
    values[:, 3:6] += velocity
    return replace(fixes, values=values)
