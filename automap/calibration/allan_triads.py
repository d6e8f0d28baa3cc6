"""Allan deviations of both triads over the longest rest of a log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.calibration.allan import AllanFit, allan_fit
from automap.calibration.limits import LONG_REST_LIMIT, MOST_LEFT_OUT, SHORT_S, TURN_HOLE_STEPS
from automap.calibration.rest import movement
from automap.errors import InputError
from automap.records import RawImu

AXES = ("accel_x", "accel_y", "accel_z", "gyro_x", "gyro_y", "gyro_z")


@dataclass(frozen=True)
class RestingFits:
    """One fit per axis, of a rest of ``seconds`` that starts at ``start_s``."""

    fits: dict[str, AllanFit]
    start_s: float
    seconds: float
    warnings: tuple[str, ...]


def resting_fits(log: RawImu) -> RestingFits:
    """Fit all six axes over the longest stretch without movement or hole, in SI units.

    Raises:
        InputError: units unknown, or no rest long enough.
    """
    if log.gyro_scale is None or log.accel_scale is None:
        raise InputError(f"{log.name} is in counts of an unknown sensor; name it with --sensor.")
    start, stop = _longest_rest(log)
    t_s = log.t_s
    seconds = float(t_s[stop - 1] - t_s[start])
    warnings = []
    if stop - start < (1.0 - MOST_LEFT_OUT) * len(log):
        warnings.append(
            f"{log.name}: the sensor moved; only its longest rest is used, {seconds:.0f} s from "
            f"{t_s[start]:.0f} s on"
        )
    if seconds < SHORT_S:
        warnings.append(
            f"{log.name}: {seconds:.0f} s at rest show the white noise; for bias instability and "
            "random walk leave the sensor alone for an hour or more"
        )
    values = np.hstack(
        [log.accel[start:stop] * log.accel_scale, log.gyro[start:stop] * log.gyro_scale]
    )
    fits = {
        axis: allan_fit(values[:, i], log.rate_hz, f"{log.name}, {axis}")
        for i, axis in enumerate(AXES)
    }
    return RestingFits(fits, float(t_s[start]), seconds, tuple(warnings))


def _longest_rest(log: RawImu) -> tuple[int, int]:
    still = movement(log) < LONG_REST_LIMIT
    still[1:] &= np.diff(log.t_ns) * 1e-9 < TURN_HOLE_STEPS / log.rate_hz
    edges = np.diff(np.concatenate([[0], still.astype(np.int8), [0]]))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    if not len(starts):
        raise InputError(f"{log.name}: the sensor is never at rest; leave it alone for an hour.")
    longest = int(np.argmax(stops - starts))
    return int(starts[longest]), int(stops[longest])
