"""The quantities of a drive as its smoothed motion shows them."""

from __future__ import annotations

import numpy as np

from automap.effects import Signals
from automap.effects.signals import signals_of
from automap.gap.fit import Fit, Motion


def motion_signals(fit: Fit, motion: Motion) -> Signals:
    """Quantities [n] at the epochs of the motion."""
    drive = fit.opened.drive
    heading = np.unwrap(np.arctan2(motion.dcm[:, 1, 0], motion.dcm[:, 0, 0]))
    along = np.einsum("ni,ni->n", motion.dcm[:, :, 0], motion.acc)
    time = motion.t + drive.begin_s
    temp = drive.imu.temp_c
    return signals_of(time, motion.vel, heading, along, motion.rate, motion.force, temp)
