"""Whether the axes of the IMU are as the manifest says, and what to write where they are not."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from automap.evaluation.plausibility import Finding
from automap.fusion.unusable_readings import bridge_unusable
from automap.gates import sigmas
from automap.io.axes import ImuAxes, axes_value
from automap.io.drive import Drive
from automap.io.recording import Recording
from automap.records import ClockModel, Fixes, FloatArray, ImuData
from automap.sync.axes import (
    AxesJudgement,
    Hypothesis,
    correlation,
    judge_stated,
    judge_unknown,
    slope,
)
from automap.sync.axes_evidence import AxesEvidence, Followed, axes_evidence
from automap.sync.limits import LEAST_SHARE
from pipeline.check import limits

CODE = "imu_axes"
"""Of findings about axes and signs."""
SCALE_CODE = "gyro_scale"
"""Of findings about the gyro's unit."""
FORCE_CODE = "accel_scale"
"""Of findings about the unit of one axis of the accelerometer; of all three gravity tells."""


@dataclass(frozen=True)
class WeighedAxes:
    """What was found, and the readings as they are to be used: with a wrong sign or order of one
    triad mended by ``mended`` where the axes are unknown, else as they were."""

    findings: tuple[Finding, ...]
    imu: ImuData
    mended: ImuAxes | None = None


def seen_motion(imu: ImuData, fixes: Fixes | None, clock: ClockModel | None) -> AxesEvidence:
    """What readings show of their axes by themselves and beside the motion of usable ``fixes``, by
    the ``clock`` of the stamps, where there are any."""
    return axes_evidence(usable_readings(imu), fixes, clock)


def weigh_axes(drive: Drive, recording: Recording, seen: AxesEvidence) -> WeighedAxes:
    """Judge the axes of a recording's IMU by what was ``seen`` of its motion."""
    imu = recording.imu
    assert imu is not None
    if imu.axes_known:
        judged = judge_stated(seen)
        scale = _gyro_scale(seen, judged.best.gyro[2], recording)
        scale += _force_scale(seen, judged.best.accel)
        return WeighedAxes((_stated(drive, seen, judged), *scale), imu)
    if seen.turn is None or seen.surge is None:
        text = "axes unknown: the mounting is estimated from the drive"
        return WeighedAxes((Finding("info", text),), imu)
    return _unknown(drive, recording, seen, judge_unknown(seen))


def usable_readings(imu: ImuData) -> ImuData:
    """The readings without wild and frozen ones; all of them where hardly any other is there."""
    keep = bridge_unusable(imu).stretch_s == 0.0
    if np.count_nonzero(keep) < 2:
        return imu
    temp = None if imu.temp_c is None else imu.temp_c[keep]
    return replace(
        imu, t_ns=imu.t_ns[keep], gyro=imu.gyro[keep], accel=imu.accel[keep], temp_c=temp
    )


def _stated(drive: Drive, seen: AxesEvidence, judged: AxesJudgement) -> Finding:
    tilt = float(np.arccos(np.clip(-seen.up[2], -1.0, 1.0)))
    facts = _facts(seen, tilt, np.eye(3))
    likely = judged.stated.probability
    if likely < limits.DOUBTED_AXES:
        wrong = likely < limits.WRONG_AXES
        return Finding(
            "error" if wrong else "warning",
            f"the IMU's axes {'are not' if wrong else 'may not be'} as stated "
            f"(probability {likely:.0e}): {what_differs(judged.best)}; {facts}",
            _advice(drive, judged),
            CODE,
        )
    if tilt > limits.TILTED_RAD:
        advice = (
            'the sensor is mounted askew: write axes = "unknown" in [imu] to have its mounting '
            "estimated"
        )
        return Finding("warning", facts, advice, CODE)
    weak = [
        what
        for what, followed, axis in (
            ("speed changes", seen.surge, np.eye(3)[0]),
            ("turns", seen.turn, np.eye(3)[2]),
        )
        if followed is not None
        and followed.share > LEAST_SHARE
        and correlation(followed, axis) < limits.WEAK_CORRELATION
    ]
    if weak:
        advice = (
            f"the IMU feels the {' and '.join(weak)} that the receiver shows in other axes: is it "
            "fixed to the vehicle?"
        )
        return Finding("warning", facts, advice, CODE)
    return Finding("ok", facts, code=CODE)


def _facts(seen: AxesEvidence, tilt: float, axes: FloatArray) -> str:
    """What speaks for or against the vehicle ``axes`` [3, 3] of readings, in figures."""
    parts = [f"gravity is {np.degrees(tilt):.0f} deg off the down axis"]
    if tilt < limits.TILTED_RAD:
        parts = [f"gravity is on the down axis, to {np.degrees(tilt):.1f} deg"]

    def figure(followed: Followed | None, axis: int, what: str) -> None:
        if followed is not None:
            parts.append(f"{what} to {correlation(followed, axes[axis]):+.2f}")

    figure(seen.surge, 0, "speed changes go with the forward force")
    figure(seen.lateral, 1, "turns with the force to the right")
    figure(seen.turn, 2, "turns with the rate about down")
    return ", ".join(parts) + (" (correlation)" if len(parts) > 1 else "")


def _advice(drive: Drive, judged: AxesJudgement) -> str:
    lines = [_line(_total(drive, found)) for found in (judged.best, *judged.others[:2])]
    text = f"write {lines[0]} in [imu]"
    if len(lines) > 1:
        text += f"; as good by what was recorded: {', or '.join(lines[1:])}"
    if len(judged.others) > 2:
        text += " and others; a longer drive with bends tells them apart"
    best = judged.best
    if np.linalg.det(best.accel) < 0.0 and np.allclose(best.gyro, -best.accel):
        text += " (a receiver's path turned from north to south or east to west looks the same)"
    return text


def _total(drive: Drive, found: Hypothesis) -> ImuAxes:
    """The axes to write for readings that the stated ones turned already."""
    stated = drive.imu_axes
    return ImuAxes(found.accel @ stated.accel, found.gyro @ stated.gyro, stated.known)


def _line(axes: ImuAxes) -> str:
    """What to write in the manifest to have these axes."""
    accel, gyro = axes.accel, axes.gyro
    one = np.allclose(accel, gyro) and np.linalg.det(accel) > 0.0
    if axes.known and one:
        return f"axes = {axes_value(accel)}"
    parts = [] if axes.known else ['axes = "unknown"']
    if axes.known or not np.allclose(accel, np.eye(3)):
        parts.append(f"accel_axes = {axes_value(accel)}")
    if axes.known or not np.allclose(gyro, np.eye(3)):
        parts.append(f"gyro_axes = {axes_value(gyro)}")
    return " and ".join(parts)


def _unknown(
    drive: Drive, recording: Recording, seen: AxesEvidence, judged: AxesJudgement
) -> WeighedAxes:
    imu, best = recording.imu, judged.best
    assert imu is not None
    assert judged.mounting is not None
    doubted = judged.stated.probability < limits.DOUBTED_AXES
    # the readings go on as what is said of them, unless that is as good as excluded
    chosen = best if doubted or best.rigid else judged.stated
    accel, gyro = judged.mounting @ chosen.accel, judged.mounting @ chosen.gyro
    facts = _facts(seen, 0.0, accel)
    scale = [*_gyro_scale(seen, gyro[2], recording), *_force_scale(seen, accel)]
    if not doubted:
        near = axes_value(_nearest(accel)).strip('"')
        text = f"axes unknown, about {near} (the mounting is estimated): {facts}"
        return WeighedAxes((Finding("info", text, code=CODE), *scale), imu)
    what = what_differs(best)
    sure = f"probability {best.probability:.4f}"
    text = f"{what} ({sure}; as recorded {judged.stated.probability:.0e}): mended for this drive"
    finding = Finding("warning", text, _advice(drive, judged), CODE)
    mended = ImuAxes(best.accel, best.gyro, known=False)
    turned_gyro, turned_accel = mended.apply(imu.gyro, imu.accel)
    imu = replace(imu, gyro=turned_gyro, accel=turned_accel)
    return WeighedAxes((finding, *scale), imu, mended)


def _nearest(matrix: FloatArray) -> FloatArray:
    """The signed permutation [3, 3] nearest to a matrix."""
    from automap.sync.axes import SIGNED_PERMUTATIONS

    fit = np.einsum("kij,ij->k", SIGNED_PERMUTATIONS, matrix)
    return np.asarray(SIGNED_PERMUTATIONS[int(np.argmax(fit))])


def what_differs(found: Hypothesis) -> str:
    """What a hypothesis says is wrong with the readings, in words."""
    if found.rigid:
        return "the sensor is mounted otherwise"
    return " and ".join(
        text
        for text in (
            _of_triad(found.accel, "the accelerometer", "minus the specific force"),
            _of_triad(found.gyro, "the gyro", "minus the rate"),
        )
        if text
    )


def _of_triad(matrix: FloatArray, name: str, negated: str) -> str:
    signs = np.diag(matrix)
    if np.all(signs > 0.0):
        return ""
    if np.all(signs < 0.0):
        return f"{name} reads {negated}"
    if np.all(np.abs(signs) > 0.0):
        turned = "xyz"[int(np.argmin(signs))] if np.sum(signs < 0.0) == 1 else ""
        return f"{name}'s {turned} axis has the wrong sign" if turned else f"{name} is turned"
    return f"{name}'s axes are in another order"


def _gyro_scale(seen: AxesEvidence, down: FloatArray, recording: Recording) -> list[Finding]:
    """An error for a gyro that turns by another factor than the course does."""
    if seen.turn is None or seen.turn.share < LEAST_SHARE:
        return []
    value, sd = slope(seen.turn, down)
    beyond = sigmas(limits.GYRO_SCALE_PROBABILITY)
    if abs(value - 1.0) <= limits.GYRO_SCALE_OFF + beyond * sd:
        return []
    assert recording.imu is not None
    rate_hz = 1e9 / float(np.median(np.diff(recording.imu.t_ns)))
    text = f"the course turns by {value:.3g} times what the gyro feels (sigma {sd:.1g})"
    units = (
        (np.pi / 180.0, 'the file is in deg/s: write gyro_unit = "deg/s" in [imu]'),
        (180.0 / np.pi, 'the file is in rad/s: write gyro_unit = "rad/s" in [imu]'),
        (rate_hz, "these are angle increments: divide by the sampling step to get rad/s"),
    )
    for factor, advice in units:
        if 1.0 / limits.NEAR_UNIT < value / factor < limits.NEAR_UNIT:
            return [Finding("error", text, advice, SCALE_CODE)]
    advice = (
        "correct gyro_unit, the sensor file, the calibration or the range that was set, or are the "
        "readings and the fixes of two drives?"
    )
    return [Finding("error", text, advice, SCALE_CODE)]


def _force_scale(seen: AxesEvidence, axes: FloatArray) -> list[Finding]:
    """What is wrong where forces along vehicle ``axes`` [3, 3] are smaller than the motion's.

    Larger ones, as hills and a turned sensor make them, are no fault of a unit.
    """
    for followed, axis, what in (
        (seen.surge, axes[0], "speed changes are {} times the force forward"),
        (seen.lateral, axes[1], "turns are {} times the force to the right"),
    ):
        if followed is None or followed.share < LEAST_SHARE:
            continue
        value, sd = slope(followed, axis)
        least = [
            value - sigmas(p) * sd for p in (limits.DOUBTED_AXES, limits.GYRO_SCALE_PROBABILITY)
        ]
        if least[0] > 1.0 + limits.GYRO_SCALE_OFF:
            wrong = least[1] > 1.0 + limits.GYRO_SCALE_OFF
            text = f"the {what.format(f'{value:.3g}')} (sigma {sd:.1g}), and gravity is right"
            advice = "one axis of the accelerometer is in another unit, as g: bring all to one"
            return [Finding("error" if wrong else "warning", text, advice, FORCE_CODE)]
    return []
