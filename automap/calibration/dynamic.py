"""Dynamic calibration: remaining errors of a sensor that is turned by hand.

The sensor is turned about several axes without being carried about, so its velocity is zero
but for the hand: the pseudo-velocity of equations (26) to (28). A hand also stays in one place,
which says far more of slow errors: a pseudo-position. How much the hand moved is estimated from
the innovations, and the noise of both measurements set accordingly; the covariance is that
under the hand's motion as it was.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.calibration import limits
from automap.calibration.dynamic_kernel import BA, N_ERRORS, N_STATES, PHI, POS, SA, run_filter
from automap.calibration.hand_motion import (
    UNKNOWN_HAND,
    coloured_noise_covariance,
    coloured_noise_history,
    final_response,
    hand_motion,
)
from automap.calibration.rest import movement, noise_density
from automap.errors import InputError
from automap.frames import matrix_to_quat, rpy_to_matrix
from automap.gates import sigmas
from automap.records import FloatArray, RawImu

ERROR_NAMES = tuple(f"{effect}_{axis}" for effect in limits.EFFECTS for axis in "xyz")


@dataclass(frozen=True)
class DynamicCalibration:
    """The errors over time, in correction form: true = (1 + scale) * reading + bias.

    ``t_s`` [n], ``quat`` [n, 4], ``errors``, ``sd`` [n, 12] in the order of ERROR_NAMES;
    ``covariance`` [12, 12] at the end. ``hand_velocity`` m/s and ``hand_place`` m,
    RMS. ``turned`` [3] rad in all about each axis. ``innovations`` [m, 10]:
    row, innovation of velocity [3], its sd [3], innovation of position [3].
    """

    t_s: FloatArray
    quat: FloatArray
    errors: FloatArray
    sd: FloatArray
    covariance: FloatArray
    hand_velocity: float
    hand_place: float
    turned: FloatArray
    innovations: FloatArray
    warnings: tuple[str, ...]

    @property
    def final(self) -> FloatArray:
        """The errors [12] at the end."""
        return np.asarray(self.errors[-1])


def calibrate_dynamic(
    log: RawImu,
    gyro: FloatArray,
    accel: FloatArray,
    gravity: float,
    prior_sd: FloatArray = limits.PRIOR_SD,
    least_s: float = limits.LEAST_LOG_S,
) -> DynamicCalibration:
    """Estimate the twelve errors of conditioned readings [n, 3] in rad/s and m/s^2: equations
    (8) to (28).

    ``log`` are the readings as logged (for the noise floor), ``gravity`` in m/s^2, ``prior_sd``
    [12] what is known of the errors before (TURN_ON_SD after a static calibration); shorter
    logs than ``least_s`` are refused.

    Raises:
        InputError: the log is too short, the filter finds no consistent motion, or a scale that
            no sensor has.
    """
    t_s = log.t_s
    if t_s[-1] < least_s:
        raise InputError(
            f"{log.name} lasts {t_s[-1]:.3g} s; turn the sensor by hand for a minute or two."
        )
    norm = float(np.median(np.linalg.norm(accel, axis=1)))
    if not limits.UNIT_RANGE[0] < norm / gravity < limits.UNIT_RANGE[1]:
        raise InputError(
            f"{log.name}: the median specific force is {norm:.4g} m/s^2 where gravity is "
            f"{gravity:.4g}; correct --accel-unit, or calibrate statically first."
        )
    still = movement(log) < limits.STILL_LIMIT
    density = noise_density(log, limits.STILL_LIMIT)
    q = np.array(
        [
            np.mean((density[:3] * _unit(accel, log.accel)) ** 2),
            np.mean((density[3:] * _unit(gyro, log.gyro)) ** 2),
        ]
    )
    at_rest = bool(still[: round(log.rate_hz)].all())
    every = max(1, round(limits.UPDATE_S * log.rate_hz), len(t_s) // limits.MOST_UPDATES)
    dt = np.diff(t_s)
    hand = UNKNOWN_HAND
    step = every / log.rate_hz
    out = np.empty((len(t_s), 4 + 2 * N_ERRORS))
    innovations = np.empty((len(t_s) // every + 1, 10))
    P, errors, count = np.zeros((N_STATES, N_STATES)), np.zeros(N_ERRORS), 0
    variance = np.empty((len(t_s), 2))
    response = np.empty((0, N_STATES, N_STATES + 6))
    for number in range(limits.PASSES):
        variance[:] = hand.variance
        variance[still, 0] = limits.STILL_SD**2
        # about the last pass's errors, so that the model is linear where it matters; but what
        # that pass did not learn stays at the prior's zero, or the prior would count less with
        # every pass
        errors -= P[BA:POS, BA:POS] @ (errors / prior_sd**2)
        quat, P = _start(log, accel, errors, at_rest, gravity, prior_sd)
        if number == limits.PASSES - 1:
            response = np.empty((len(innovations), N_STATES, N_STATES + 6))
        count = run_filter(
            dt, np.ascontiguousarray(gyro), np.ascontiguousarray(accel), gravity, quat,
            errors, P, q, every, variance, limits.WALK**2, out, innovations,
            response,
        )  # fmt: skip
        rows = innovations[:count, 0].astype(np.int64)
        hand = hand_motion(innovations[:count], ~still[rows], step)
    if not np.all(np.isfinite(out[-1])):
        raise InputError(f"{log.name}: the filter diverged; check units and axes, record again.")
    scale = out[-1, 4 + SA - BA : 4 + N_ERRORS]
    wrong = (scale < limits.UNIT_RANGE[0] - 1.0) | (scale > limits.UNIT_RANGE[1] - 1.0)
    if wrong.any():
        worst = int(np.argmax(np.where(wrong, np.abs(scale), 0.0)))
        raise InputError(
            f"{log.name}: {ERROR_NAMES[SA - BA + worst]} would be {100.0 * scale[worst]:.0f} %, "
            "as no sensor's is; turn it by hand and in place, and look whether the static "
            "calibration is that of this sensor, and units and axes those of its log."
        )
    covariance = coloured_noise_covariance(
        P[BA:POS, BA:POS],
        final_response(response[:count]),
        variance[rows],
        innovations[:count],
        ~still[rows],
        step,
    )
    turned = np.sum(np.abs(0.5 * (gyro[1:] + gyro[:-1])) * dt[:, None], axis=0)
    result = DynamicCalibration(
        t_s=t_s,
        quat=out[:, :4].copy(),
        errors=out[:, 4 : 4 + N_ERRORS].copy(),
        sd=coloured_noise_history(out[:, 4 + N_ERRORS :], prior_sd, np.sqrt(np.diag(covariance))),
        covariance=covariance,
        hand_velocity=hand.velocity,
        hand_place=hand.place,
        turned=turned,
        innovations=innovations[:count].copy(),
        warnings=(),
    )
    return _judged(result, log, prior_sd)


def _unit(si: FloatArray, raw: FloatArray) -> float:
    """SI value of a reading unit, by the spread of both."""
    return float(np.median(si.std(axis=0) / (raw.std(axis=0) + 1e-300)))


def _start(
    log: RawImu,
    accel: FloatArray,
    errors: FloatArray,
    at_rest: bool,
    gravity: float,
    prior_sd: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Initial quaternion [4] by levelling the first second, and covariance [21, 21]."""
    rows = slice(0, max(2, round(limits.LEAST_REST_S * log.rate_hz)))
    f = (1.0 + errors[6:9]) * accel[rows].mean(axis=0) + errors[:3]
    roll, pitch = np.arctan2(-f[1], -f[2]), np.arctan2(f[0], np.hypot(f[1], f[2]))
    C = rpy_to_matrix(np.array([roll, pitch, 0.0]))
    # a biased accelerometer levels wrongly by just what hides its bias: phi = level @ errors
    level = np.zeros((3, N_ERRORS))
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]) / gravity
    level[:, :3] = turn @ C
    level[:, 6:9] = turn @ C * f
    prior = np.diag(prior_sd**2)
    tilt_sd = limits.LEVEL_SD_REST if at_rest else limits.LEVEL_SD_MOVING
    P = np.zeros((N_STATES, N_STATES))
    P[:3, :3] = (limits.START_SPEED_REST if at_rest else limits.START_SPEED_MOVING) ** 2 * np.eye(3)
    # heading cannot be seen and does not matter
    P[PHI:BA, PHI:BA] = level @ prior @ level.T + np.diag([tilt_sd**2, tilt_sd**2, 1e-12])
    P[PHI:BA, BA:POS] = level @ prior
    P[BA:POS, PHI:BA] = prior @ level.T
    P[BA:POS, BA:POS] = prior
    P[POS:, POS:] = limits.START_PLACE_M**2 * np.eye(3)
    return matrix_to_quat(C), P


def _judged(result: DynamicCalibration, log: RawImu, prior_sd: FloatArray) -> DynamicCalibration:
    """The result with a sentence for everything that the motion leaves open."""
    from dataclasses import replace

    found = []
    for axis, angle in zip("xyz", result.turned, strict=True):
        if angle < limits.LEAST_TURN:
            found.append(
                f"{log.name}: turned by only {np.degrees(angle):.0f} deg in all about {axis}; turn "
                f"the sensor to and fro about its {axis} axis by 90 degrees or more, several times"
            )
    if result.hand_velocity > limits.MUCH_TRANSLATION:
        found.append(
            f"{log.name}: the sensor was carried about at {result.hand_velocity:.2f} m/s RMS, too "
            "much for a pseudo-velocity of zero; turn it in place"
        )
    open_ones = [
        name
        for name, sd, prior in zip(ERROR_NAMES, result.sd[-1], prior_sd, strict=True)
        if sd > limits.WELL_KNOWN * prior and "bias" in name
    ]
    if open_ones:
        found.append(
            f"{log.name}: {', '.join(open_ones)} stay open; turn the sensor through more attitudes"
        )
    ratio = np.abs(result.final) / prior_sd
    worst = int(ratio.argmax())
    if ratio[worst] > sigmas(limits.OTHER_SENSOR_PROBABILITY / N_ERRORS):
        found.append(
            f"{log.name}: {ERROR_NAMES[worst]} is {ratio[worst]:.0f} times what may be expected of "
            "a sensor before this calibration; is the static calibration that of this sensor, and "
            "are units and axes those of its log?"
        )
    return replace(result, warnings=tuple(found))
