"""Logs that no calibration can use: dead or saturated axes, swapped sensors, impossible units."""

from __future__ import annotations

import math

import numpy as np

from automap.calibration.limits import (
    CUT_OFF,
    LEAST_RUN,
    RANGES,
    SATURATION_PROBABILITY,
    UNIT_RANGE,
)
from automap.earth import STANDARD_GRAVITY
from automap.errors import InputError
from automap.records import FloatArray, RawImu


def refuse_saturation(log: RawImu) -> None:
    """Raise when an axis stays at its extreme for longer than chance and resolution explain, or
    reads one value throughout, as one that is not there."""
    for sensor, values in (("accelerometer", log.accel), ("gyro", log.gyro)):
        for i, axis in enumerate("xyz"):
            if len(values) and np.ptp(values[:, i]) == 0.0:
                raise InputError(
                    f"{log.name}: the {sensor}'s {axis} axis reads {values[0, i]:.6g} from the "
                    "first sample to the last; name the columns that it was recorded in, or "
                    "record again."
                )
            place = _saturated(values[:, i])
            if place is None:
                continue
            row, length, value = place
            raise InputError(
                f"{log.name}: the {sensor}'s {axis} axis is saturated: from "
                f"{log.t_s[row]:.2f} s on it reads its extreme {value:.6g} for {length} samples; "
                "turn it more slowly or set a wider range, and record again."
            )


def _saturated(x: FloatArray) -> tuple[int, int, float] | None:
    """First row, length and value of a run at the largest or least reading, if any."""
    low, high = float(x.min()), float(x.max())
    same = np.diff(x) == 0.0
    # how often neighbours agree by resolution alone: away from the two extremes
    inner = (x[1:] > low) & (x[1:] < high)
    agree = (np.count_nonzero(same & inner) + 1.0) / (np.count_nonzero(inner) + 2.0)
    for value in (high, low):
        at = np.concatenate([[0], (x == value).astype(np.int8), [0]])
        starts, stops = np.flatnonzero(np.diff(at) == 1), np.flatnonzero(np.diff(at) == -1)
        lengths = stops - starts
        longest = int(lengths.argmax())
        length = int(lengths[longest])
        chance = len(x) * agree ** (length - 1)
        # a sensor at rest may sit at its extreme; one that is cut off arrives there in a rush
        if (
            length >= LEAST_RUN
            and chance < SATURATION_PROBABILITY
            and _cut_off(x, starts[longest], length)
        ):
            return int(starts[longest]), length, value
    return None


def _cut_off(x: FloatArray, start: int, length: int) -> bool:
    """Whether the run's neighbourhood moves far more than the run itself."""
    around = x[max(0, start - 2 * length) : start + 3 * length]
    return bool(np.ptp(around) > CUT_OFF * np.ptp(x))


def refuse_swapped(log: RawImu) -> None:
    """Raise when it is the gyro that feels gravity, in any unit, and not the accelerometer, in
    any or the stated one."""
    if log.gyro_scale is None or log.accel_scale is None:
        return
    stated = log.accel * log.accel_scale
    turn, force, in_si = (
        float(np.median(np.linalg.norm(x, axis=1))) for x in (log.gyro, log.accel, stated)
    )
    if _is_gravity(turn) and not (_is_gravity(force) or _is_gravity(in_si)):
        raise InputError(
            f"{log.name}: the columns of gyro and accelerometer are swapped: the gyro's are "
            f"{turn:.4g} long in the median, as gravity is, and the accelerometer's {force:.2g}; "
            "name them the other way round."
        )


def _is_gravity(size: float) -> bool:
    """Whether readings of that size are gravity's in m/s^2, g or milli-g."""
    low, high = UNIT_RANGE
    return any(low < size / one < high for one in (STANDARD_GRAVITY, 1.0, 1000.0))


def refuse_wrong_accel_unit(log: RawImu, scale: FloatArray) -> None:
    """Raise when gravity's size in the readings belies their unit."""
    if log.accel_scale is not None:
        _refuse(log.name, "accelerometer", "--accel-unit", log.accel_unit, scale / log.accel_scale,
                (("g", STANDARD_GRAVITY), ("milli-g", 1e-3 * STANDARD_GRAVITY),
                 ("m/s^2", 1.0 / STANDARD_GRAVITY)))  # fmt: skip


def refuse_wrong_gyro_unit(log: RawImu, scale: FloatArray) -> None:
    """Raise when the turns of gravity belie the unit of the gyro's readings."""
    if log.gyro_scale is not None:
        _refuse(log.name, "gyro", "--gyro-unit", log.gyro_unit, scale / log.gyro_scale,
                (("deg/s", np.pi / 180.0), ("rad/s", 180.0 / np.pi)))  # fmt: skip


def _refuse(
    name: str, sensor: str, option: str, unit: str, ratio: FloatArray,
    others: tuple[tuple[str, float], ...],
) -> None:  # fmt: skip
    """``ratio`` [3] of found to stated scale; ``others`` what it is for other units."""
    middle = float(np.median(ratio))
    low, high = UNIT_RANGE
    if low < middle < high:
        return
    times = 2.0 ** round(math.log2(middle)) if middle > 0.0 else 1.0
    near = [text for text, value in others if low < middle / value < high and text != unit]
    if unit == "counts" and 1.0 / RANGES <= times <= RANGES and low < middle / times < high:
        advice = (
            f"they fit {times:g} times the range of the data sheet, so name a sheet of that range "
            f"with --sensor, its counts_per_unit {1.0 / times:g} times as large"
        )
    elif unit == "counts":
        advice = "name the right data sheet with --sensor, or correct its counts_per_unit"
    elif near:
        unit_said = near[0].removeprefix("milli-")
        divide = "divide by 1000 and " if unit_said != near[0] else ""
        advice = f"it fits {near[0]}, so {divide}say {option} {unit_said}"
    elif sensor == "gyro":
        advice = f"correct {option}, the time column or --rate"
    else:
        advice = f"correct {option}, or give counts with {option} counts"
    raise InputError(
        f"{name}: the {sensor}'s readings cannot be in {unit}: they are {1.0 / middle:.4g} times "
        f"what gravity demands; {advice}."
    )
