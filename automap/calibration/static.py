"""Static calibration: from raw logs with rest poses to the calibration of both triads."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.special import chdtrc, fdtrc

from automap.calibration import limits
from automap.calibration.accelerometer import (
    N_NINE,
    N_SIX,
    AccelFit,
    LeftOut,
    directions_of,
    fit_accelerometer,
    leave_one_out,
)
from automap.calibration.gyroscope import GyroFit, fit_gyro, turns_between
from automap.calibration.plausible import (
    refuse_saturation,
    refuse_swapped,
    refuse_wrong_accel_unit,
    refuse_wrong_gyro_unit,
)
from automap.calibration.poses import determination, helpful_poses
from automap.calibration.rest import Rest
from automap.calibration.rest_search import RestSearch, find_rests, least_poses, pose_means
from automap.errors import InputError
from automap.records import FloatArray, RawImu

_TURN = "turn the sensor by 90 degrees or more about each axis between rests"
_PUT_DOWN = "put it down for each rest, leaned against a box where it does not stand by itself"


@dataclass(frozen=True)
class StaticCalibration:
    """What `calibrate static` finds.

    ``accel`` with nine parameters or six, ``accel_six`` the paper's model for comparison;
    ``left_out`` None when there is no pose to spare. ``gyro`` None when the turns do not
    determine it: then ``gyro_scale`` (from the data sheet) and ``gyro_bias`` hold, equations
    (2) and (3). ``gyro_with_g`` is the gyro with g-sensitivity, None when not determined.
    """

    search: RestSearch
    gravity: float
    accel: AccelFit
    accel_six: AccelFit
    left_out: LeftOut | None
    gyro: GyroFit | None
    gyro_with_g: GyroFit | None
    gyro_scale: FloatArray
    gyro_bias: FloatArray
    turns: int
    warnings: tuple[str, ...] = field(default=())


def calibrate_static(
    logs: list[RawImu], gravity: float, n_parameters: int | None = None
) -> StaticCalibration:
    """Calibrate the accelerometer from rest poses and the gyro from the turns between them:
    equations (1) to (7), the turns after Tedaldi, Pretto and Menegatti, ICRA 2014.

    ``gravity`` in m/s^2. ``n_parameters`` 6 or 9 of the accelerometer; None takes nine where
    the poses determine them, else six with a warning.

    Raises:
        InputError: no rest, too few poses, poses that leave a parameter open (the sentence
            names those that would help), a dead or saturated axis, swapped sensors, a unit that
            cannot be.
    """
    for log in logs:
        refuse_saturation(log)
        refuse_swapped(log)
    warnings: list[str] = []
    wanted = n_parameters or N_NINE
    search = find_rests(logs, gravity, wanted)
    if not search.determined and n_parameters is None:
        search = find_rests(logs, gravity, N_SIX)
        if search.determined:
            wanted = N_SIX
            warnings.append(_six_only(search.rests))
    if not search.determined:
        raise InputError(_too_few(logs, search, n_parameters or N_SIX))
    means, variances = pose_means(search.rests)
    accel = fit_accelerometer(means, variances, gravity, wanted, limits.ANGLE_SD)
    refuse_wrong_accel_unit(logs[0], accel.scale)
    if accel.residual_rms > limits.NOT_AT_REST * gravity:
        raise InputError(
            f"{_names(logs)}: in the quietest stretches the calibrated norm still misses gravity "
            f"by {accel.residual_rms:.2g} m/s^2 RMS, so the sensor was not at rest there; put it "
            "down, or hold it still, for some seconds in each pose."
        )
    warnings += _pose_warnings(search, means, accel)
    warnings += _drift_warning(logs, search.rests, directions_of(accel, means), accel)
    six = fit_accelerometer(means, variances, gravity, N_SIX)
    gyro_part = _gyro(logs, search, accel, gravity, warnings)
    return StaticCalibration(
        search=search,
        gravity=gravity,
        accel=accel,
        accel_six=six,
        left_out=leave_one_out(means, variances, gravity, accel, limits.ANGLE_SD),
        gyro=gyro_part[0],
        gyro_with_g=gyro_part[1],
        gyro_scale=gyro_part[2],
        gyro_bias=gyro_part[3],
        turns=gyro_part[4],
        warnings=tuple(warnings),
    )


def _names(logs: list[RawImu]) -> str:
    return ", ".join(log.name for log in logs)


def _too_few(logs: list[RawImu], search: RestSearch, n_parameters: int) -> str:
    """Why no limit gave poses enough, and which would help."""
    rests = search.rests
    if len(rests) < 2:
        found = "no rest" if not rests else "only one rest"
        return (
            f"{_names(logs)}: {found} of a second or more was found; hold the sensor still for "
            f"some seconds in each of {least_poses(n_parameters)} or more poses, better 12."
        )
    poses = helpful_poses(_rough_directions(rests), n_parameters)
    missing = "; ".join(poses) if poses else "any that differ from these"
    count = f"{len(rests)} rest pose{'s' if len(rests) > 1 else ''}"
    if len(rests) < least_poses(n_parameters):
        return (
            f"{_names(logs)}: {count} found, too few for {n_parameters} parameters; hold the "
            f"sensor still in at least {least_poses(n_parameters)}, better 12. Add: {missing}."
        )
    return (
        f"{_names(logs)}: the {count} leave an accelerometer parameter open, as when all lie in "
        f"one plane; hold the sensor still in further ones. Add: {missing}."
    )


def _rough_directions(rests: list[Rest]) -> FloatArray:
    """Unit directions [k, 3] good to some degrees, before any calibration.

    An axis that was never turned upside down has its zero at one end of its span: the centre
    is then better taken from the sphere through the means, nearest to the origin.
    """
    means, _ = pose_means(rests)
    y = means - means.mean(axis=0)
    design = np.column_stack([2.0 * y, np.ones(len(y))])
    # least norm: a direction without information keeps the mean as its centre
    solution = np.linalg.lstsq(design, np.sum(y**2, axis=1), rcond=1e-3)[0]
    vectors = y - solution[:3]
    return np.asarray(vectors / (np.linalg.norm(vectors, axis=1)[:, None] + 1e-300))


def _six_only(rests: list[Rest]) -> str:
    poses = helpful_poses(_rough_directions(rests), N_NINE)
    advice = f" Add: {'; '.join(poses)}." if poses else " Add more poses."
    return (
        "the poses do not determine the three angles of non-orthogonality, so they are taken as "
        f"zero to {1e3 * limits.ANGLE_SD:.0f} mrad, as of usual sensors (six parameters)." + advice
    )


def _pose_warnings(search: RestSearch, means: FloatArray, accel: AccelFit) -> list[str]:
    found = []
    rests = search.rests
    if len(rests) < limits.GOOD_POSES:
        found.append(f"{len(rests)} rest poses; twelve or more average the errors out better")
    directions = directions_of(accel, means)
    strength = determination(directions, accel.n_parameters)
    if strength < limits.UNEVEN_SINGULAR:
        # the nearest missing ones, although the parameters can just be told apart
        axes = [
            f"{sign}{name} up"
            for i, name in enumerate("xyz")
            for sign, part in (("+", directions[:, i]), ("-", -directions[:, i]))
            if part.max() < limits.COVERED_AXIS
        ]
        poses = axes or helpful_poses(directions, accel.n_parameters)
        if poses:
            found.append("the poses cover the directions unevenly; add: " + "; ".join(poses))
    if search.moved > limits.STILL_LIMIT:
        found.append(
            f"the sensor moved in its rests by {np.sqrt(search.moved):.0f} times its noise, as in "
            f"a hand, which costs accuracy; {_PUT_DOWN}"
        )
    for rest in search.outliers:
        found.append(
            f"the rest near {rest.middle_s:.0f} s is left out: its norm contradicts the others"
        )
    return found


def _drift_warning(
    logs: list[RawImu], rests: list[Rest], directions: FloatArray, accel: AccelFit
) -> list[str]:
    """A sentence where a bias that grows with time explains what the fit leaves far better than
    chance: the F test of three more parameters beside those of ``accel``, all taken as linear."""
    spare = len(rests) - accel.n_parameters - 3
    if len(logs) > 1 or spare < limits.LEAST_SPARE:
        return []
    x, y, z = directions.T
    norm = np.column_stack([directions**2, directions, x * y, x * z, y * z])
    t = np.array([rest.middle_s for rest in rests])
    weight = 1.0 / accel.residual_sd
    design = np.hstack([norm[:, : accel.n_parameters], directions * (t - t.mean())[:, None]])
    design, left = design * weight[:, None], accel.residuals * weight
    rate, _, _, _ = np.linalg.lstsq(design, left, rcond=None)
    plain = design[:, : accel.n_parameters]
    without = left - plain @ np.linalg.lstsq(plain, left, rcond=None)[0]
    rest = float(np.sum((left - design @ rate) ** 2))
    gain = (float(without @ without) - rest) / 3.0
    if fdtrc(3.0, float(spare), gain / max(rest / spare, 1e-300)) > limits.DRIFT_PROBABILITY:
        return []
    moved = rate[-3:] * float(np.ptp(t))
    axis = int(np.argmax(np.abs(moved)))
    return [
        f"the accelerometer's zero moves by {abs(moved[axis]):.2g} m/s^2 about {'xyz'[axis]} in "
        f"the {float(np.ptp(t)):.0f} s of the rests, as of a sensor that warms up: its calibration "
        "is of no time in particular and errs by more than it says; let it warm up before"
    ]


def _gyro(
    logs: list[RawImu],
    search: RestSearch,
    accel: AccelFit,
    gravity: float,
    warnings: list[str],
) -> tuple[GyroFit | None, GyroFit | None, FloatArray, FloatArray, int]:
    """The gyro's calibration with and without g-sensitivity; scale and bias; turns used."""
    rests = search.gyro_rests
    means, variances = pose_means(rests)
    forces = [accel.apply(log.accel) for log in logs]
    directions = directions_of(accel, means)
    spread = (variances * accel.scale**2 + accel.floor**2) / gravity**2
    turns = turns_between(logs, forces, rests, directions, spread, gravity)
    offset = np.average([r.gyro for r in rests], axis=0, weights=[r.length_s for r in rests])
    sheet = logs[0].gyro_scale
    reason = "fewer than six turns between rests" if len(turns) < limits.LEAST_TURNS else ""
    loose: list[str] = []
    if not reason:
        fit = fit_gyro(logs, forces, rests, turns, accel, gravity)
        loose = [
            axis
            for axis, width, scale in zip("xyz", fit.half_width[:3], fit.scale, strict=True)
            if not width < limits.LOOSE_SCALE * abs(scale)
        ]
        if not loose:
            refuse_wrong_gyro_unit(logs[0], fit.scale)
            with_g = None
            if len(turns) >= limits.LEAST_TURNS_WITH_G:
                with_g = fit_gyro(logs, forces, rests, turns, accel, gravity, True)
            return fit, with_g, fit.scale, fit.bias, len(turns)
        reason = f"turns that leave the scale about {', '.join(loose)} open"
    # of rests that moved it is not the turns that want more
    advice = _PUT_DOWN if loose and search.moved > limits.STILL_LIMIT else _TURN
    if loose and sheet is not None:
        far = np.array([rest.gyro for rest in rests]) - offset
        own = np.array([rest.gyro_var for rest in rests])
        off = np.linalg.norm(far * sheet, axis=1)
        carried = np.array([off[turn.first] * turn.seconds for turn in turns])
        # more than noise, and more than half of the variance of what the turns leave
        by_chance = float(chdtrc(3.0 * (len(rests) - 1), float(np.sum(far**2 / own))))
        if by_chance < limits.DRIFT_PROBABILITY and np.mean(carried**2) > 0.5 * fit.turn_rms**2:
            advice = (
                f"its rate at rest is up to {np.degrees(off.max()):.2g} deg/s off its mean, which "
                "is what the turns miss by, as of a sensor that warms up; let it warm up before"
            )
    if sheet is None:
        raise InputError(
            f"{_names(logs)} has {reason}, so the gyro's scale per count cannot be estimated; "
            f"{advice}, or name its data sheet with --sensor."
        )
    warnings.append(
        f"the log has {reason}: the gyro's scale is the data sheet's, its misalignment zero; "
        + advice
    )
    return None, None, sheet, -sheet * offset, len(turns)
