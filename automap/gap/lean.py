"""By how much a sensor leans in its vehicle, as its weight tells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from automap.frames import quat_to_rpy
from automap.fusion.filtered import full_covariance
from automap.fusion.layout import PHI_ID
from automap.fusion.limits import ROAD_ROLL_SD
from automap.fusion.passes import Pass, Session

LEANS = ("imu_mounting", "roll")
"""Effect and parameter of what a sensor leans by in its vehicle. Vehicles do not lean in the mean
of a drive; the vehicle constraint does not tell a roll of the mounting, and fixes do by the arm
alone, as an arm to the side does. So its weight tells."""


def leaning(last: Pass) -> tuple[float, float]:
    """Mean roll of the sensor's axes along a drive, rad, and the variance with which that is the
    mounting's: what the filter does not know of it, and ``ROAD_ROLL_SD``."""
    cov = full_covariance(last.forward.store.cov[-1:], last.problem.model.size)[0]
    tilt = 0.5 * float(cov[PHI_ID, PHI_ID] + cov[PHI_ID + 1, PHI_ID + 1])
    roll = quat_to_rpy(last.smooth.nominal[:, 6:10])[:, 0]
    return float(roll.mean()), ROAD_ROLL_SD**2 + tilt


def told_by_weight(session: Session, about: Pass) -> Session:
    """A session that estimates the mounting, begun with what another pass tells of its roll."""
    name = "_".join(LEANS)
    mean, var = session.means.get(name, 0.0), session.sds[name] ** 2
    lean, its_var = leaning(about)
    share = var / (var + its_var)
    mean += share * (lean - mean)
    sd = float(np.sqrt(share * its_var))
    return replace(session, means={**session.means, name: mean}, sds={**session.sds, name: sd})
