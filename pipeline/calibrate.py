"""``automap calibrate``: logs in, calibration file, report and corrected logs out."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from automap.errors import ConfigError
from automap.io.imu_calibration import ImuCalibration, TriadCalibration
from automap.records import FloatArray

if TYPE_CHECKING:
    from automap.calibration.dynamic import DynamicCalibration
    from automap.calibration.static import StaticCalibration
    from automap.io.imu_log import ImuLog

FILE = "imu_calibration.toml"
REPORT = "calibration.html"
NOISE = "noise.toml"
STANDARD_GRAVITY = 9.80665
Sections = dict[str, dict[str, Any]]


@dataclass(frozen=True)
class LogSource:
    """Where the readings are: ``logs``, or one file of each sensor; and how to read them."""

    logs: tuple[Path, ...] = ()
    accel: Path | None = None
    gyro: Path | None = None
    columns: tuple[str, ...] = ()
    rate_hz: float | None = None
    gyro_unit: str | None = None
    accel_unit: str | None = None
    sensor: str | None = None


@dataclass(frozen=True)
class Outcome:
    """What a calibration wrote, in one sentence and a list, and what it warned of."""

    summary: str
    files: tuple[Path, ...]
    warnings: tuple[str, ...]


def _say(text: str) -> None:
    print(f"warning: {text}", file=sys.stderr)


def read_logs(source: LogSource) -> list[ImuLog]:
    """Read all logs of a source; ConfigError when none, or only half of a pair, is named."""
    from automap.io.imu_log import LogFormat, read_imu_log, read_imu_pair
    from automap.io.sensor_file import find_sensor, read_sensor

    sensor = None if source.sensor is None else read_sensor(find_sensor(source.sensor))
    form = LogFormat(source.columns, source.rate_hz, source.gyro_unit, source.accel_unit, sensor)
    logs = [read_imu_log(path, form) for path in source.logs]
    if (source.accel is None) != (source.gyro is None):
        raise ConfigError("--accel and --gyro go together: name both files, or a single LOG.")
    if source.accel is not None and source.gyro is not None:
        logs.append(read_imu_pair(source.accel, source.gyro, form))
    if not logs:
        raise ConfigError("no log is named; give a LOG, or --accel FILE and --gyro FILE.")
    units = {(log.data.gyro_unit, log.data.accel_unit) for log in logs}
    if len(units) > 1:
        raise ConfigError("the logs are in different units; calibrate them one by one.")
    return logs


def local_gravity(
    gravity: float | None, place: tuple[float, float] | None
) -> tuple[float, list[str]]:
    """Gravity in m/s^2 as given, or of a place (latitude deg, height m), or the standard one.

    Returns it with a warning when neither is given.
    """
    if gravity is not None:
        if not 9.7 < gravity < 9.9:
            raise ConfigError(f"--gravity {gravity:g} is not the Earth's; it lies near 9.8 m/s^2.")
        return gravity, []
    if place is not None:
        from automap.earth import gravity as normal_gravity

        return float(normal_gravity(np.radians(place[0]), place[1])), []
    return STANDARD_GRAVITY, [
        "neither --gravity nor --place is given: standard gravity is taken, and the "
        "accelerometer's scale may be off by up to 0.3 %"
    ]


def static(
    source: LogSource,
    out: Path,
    gravity: float | None = None,
    place: tuple[float, float] | None = None,
    parameters: int | None = None,
    g_sensitivity: bool = False,
    apply: bool = False,
    warn: Callable[[str], None] = _say,
) -> Outcome:
    """``calibrate static``: rest poses and turns to scale, bias and misalignment."""
    from automap.calibration.static import calibrate_static
    from pipeline.calibration_report import static_report

    logs = read_logs(source)
    g, warnings = local_gravity(gravity, place)
    result = calibrate_static([log.data for log in logs], g, parameters)
    chosen = result.gyro_with_g if g_sensitivity else result.gyro
    if g_sensitivity and chosen is None:
        raise ConfigError(
            "the turns do not determine the g-sensitivity; record eight or more, or leave "
            "--g-sensitivity out."
        )
    read = [text for log in logs for text in log.warnings]
    warnings = _told(read + warnings + list(result.warnings), warn)
    accel = result.accel
    covariance = chosen.covariance if chosen is not None else None
    sections: Sections = {
        "accel": {
            "scale": accel.scale,
            "bias": accel.bias,
            "misalignment": accel.misalignment,
            "covariance": accel.covariance,
            "residual_rms": accel.residual_rms,
            "poses": len(accel.residuals),
            "parameters": accel.n_parameters,
        },
        "gyro": {
            "scale": chosen.scale if chosen else result.gyro_scale,
            "bias": chosen.bias if chosen else result.gyro_bias,
            "matrix": chosen.matrix if chosen else np.eye(3),
            "g_sensitivity": chosen.g_sensitivity if chosen and chosen.with_g else None,
            "covariance": covariance,
            "turns": result.turns if chosen else 0,
            "turn_rms_deg": float(np.degrees(chosen.turn_rms)) if chosen else None,
        },
        "conditions": _conditions("static", logs, g),
    }
    if result.left_out is not None:
        sections["accel"]["left_out_rms"] = result.left_out.rms
    calibration = ImuCalibration(
        TriadCalibration(accel.scale, accel.bias, accel.matrix),
        TriadCalibration(*(sections["gyro"][k] for k in ("scale", "bias", "matrix"))),
        g_sensitivity=chosen.g_sensitivity if chosen else np.zeros((3, 3)),
    )
    page = static_report(result, logs, sections, warnings)
    files = _write(out, sections, page, logs, calibration if apply else None)
    return Outcome(_static_summary(result), files, tuple(warnings))


def _static_summary(result: StaticCalibration) -> str:
    text = (
        f"{len(result.accel.residuals)} rest poses, norm within "
        f"{result.accel.residual_rms:.5f} m/s^2 RMS of gravity"
    )
    if result.gyro is not None:
        text += (
            f"; {result.turns} turns, gravity within {np.degrees(result.gyro.turn_rms):.3f} deg RMS"
        )
    if result.gyro_with_g is not None:
        text += f" ({np.degrees(result.gyro_with_g.turn_rms):.3f} with --g-sensitivity)"
    return text


def dynamic(
    source: LogSource,
    out: Path,
    gravity: float | None = None,
    place: tuple[float, float] | None = None,
    calibration: Path | None = None,
    apply: bool = False,
    warn: Callable[[str], None] = _say,
) -> Outcome:
    """``calibrate dynamic``: remaining errors of a sensor turned by hand, on top of a static
    calibration where one is given."""
    from automap.calibration.dynamic import PRIOR_SD, TURN_ON_SD, calibrate_dynamic
    from automap.calibration.plausible import refuse_saturation
    from automap.io.imu_calibration import read_imu_calibration
    from pipeline.calibration_report import dynamic_report

    logs = read_logs(source)
    if len(logs) > 1:
        raise ConfigError("a dynamic calibration takes one log, of one turn-on.")
    log = logs[0].data
    refuse_saturation(log)
    g, warnings = local_gravity(gravity, place)
    before = _stated(logs[0]) if calibration is None else read_imu_calibration(calibration)
    gyro, accel = before.apply(log.gyro, log.accel)
    prior = PRIOR_SD if calibration is None else TURN_ON_SD
    result = calibrate_dynamic(log, gyro, accel, g, prior)
    warnings = _told(list(logs[0].warnings) + warnings + list(result.warnings), warn)
    after = corrected(before, result.final)
    names = ("scale", "bias")
    sections: Sections = {
        "accel": {
            **{k: getattr(after.accel, k) for k in names},
            "misalignment": _angles(after.accel.matrix),
            "covariance": _folded_covariance(before.accel, result.covariance, (0, 6), 9),
        },
        "gyro": {
            **{k: getattr(after.gyro, k) for k in names},
            "matrix": after.gyro.matrix,
            "g_sensitivity": after.g_sensitivity if np.any(after.g_sensitivity) else None,
            "covariance": _folded_covariance(before.gyro, result.covariance, (3, 9), 12),
        },
        "dynamic": _dynamic_section(result),
        "conditions": _conditions("dynamic", logs, g),
    }
    if calibration is not None:
        sections["conditions"]["after"] = _digest_entry(calibration)
    page = dynamic_report(result, logs[0], gyro, accel, sections, warnings)
    files = _write(out, sections, page, logs, after if apply else None)
    bias = ", ".join(f"{np.degrees(v):.4f}" for v in result.final[3:6])
    summary = f"gyro bias correction {bias} deg/s; hand {result.hand_velocity:.2f} m/s RMS"
    return Outcome(summary, files, tuple(warnings))


def _dynamic_section(result: DynamicCalibration) -> dict[str, Any]:
    """The twelve errors in correction form, equations (10) and (11), with covariance."""
    e = result.final
    return {
        "accel_bias": e[:3],
        "gyro_bias": e[3:6],
        "accel_scale": e[6:9],
        "gyro_scale": e[9:],
        "covariance": result.covariance,
        "hand_velocity_rms": result.hand_velocity,
        "turned_deg": np.degrees(result.turned),
    }


def _stated(log: ImuLog) -> ImuCalibration:
    """The data sheet's scale and zero as a calibration."""
    raw = log.data
    if raw.gyro_scale is None or raw.accel_scale is None:
        raise ConfigError(
            f"{raw.name} is in counts; name its static calibration with --calibration, or its "
            "data sheet with --sensor."
        )
    parts = []
    for scale, zero in ((raw.accel_scale, raw.accel_zero), (raw.gyro_scale, raw.gyro_zero)):
        bias = np.zeros(3) if zero is None else -scale * zero
        parts.append(TriadCalibration(scale, bias, np.eye(3)))
    return ImuCalibration(parts[0], parts[1])


def corrected(before: ImuCalibration, errors: FloatArray) -> ImuCalibration:
    """The calibration with the dynamic errors [12] folded in, in the same form.

    D T (s r + b) + beta = (D T D^-1) (D s r + D b + (D T D^-1)^-1 beta), D = 1 + scale.
    """

    def fold(triad: TriadCalibration, bias: FloatArray, scale: FloatArray) -> TriadCalibration:
        d = 1.0 + scale
        matrix = triad.matrix * d[:, None] / d
        return TriadCalibration(
            d * triad.scale, d * triad.bias + np.linalg.solve(matrix, bias), matrix
        )

    accel = fold(before.accel, errors[:3], errors[6:9])
    gyro = fold(before.gyro, errors[3:6], errors[9:])
    # true = D (M r - G f) + beta, and f is itself corrected by far less than matters here
    g = before.g_sensitivity * (1.0 + errors[9:])[:, None]
    return ImuCalibration(accel, gyro, g_sensitivity=g)


def _folded_covariance(
    before: TriadCalibration, errors: FloatArray, at: tuple[int, int], size: int
) -> FloatArray:
    """Covariance [size, size] of scale and bias after folding in errors of covariance [12, 12].

    ``at`` are the places of bias and scale in the errors. The matrix is that of ``before``,
    whose own uncertainty the dynamic calibration does not know: its rows are zero.
    """
    rows = np.r_[at[1] : at[1] + 3, at[0] : at[0] + 3]
    J = np.eye(6)
    J[:3, :3] = np.diag(before.scale)
    J[3:, :3] = np.diag(before.bias)
    covariance = np.zeros((size, size))
    covariance[:6, :6] = J @ errors[np.ix_(rows, rows)] @ J.T
    return covariance


def _angles(T: FloatArray) -> FloatArray:
    """m0, m1, m2 of T = [[1, -m0, m1], [0, 1, -m2], [0, 0, 1]]."""
    return np.array([-T[0, 1], T[0, 2], -T[1, 2]])


def allan(source: LogSource, out: Path, warn: Callable[[str], None] = _say) -> Outcome:
    """``calibrate allan``: white noise, bias instability and random walk of a resting log."""
    from automap.calibration.allan_triads import AXES, resting_fits
    from automap.io.atomic import write_text
    from pipeline.calibration_report import allan_report

    logs = read_logs(source)
    if len(logs) > 1:
        raise ConfigError("an Allan deviation takes one log, of one long rest.")
    raw = logs[0].data
    if raw.gyro_scale is None or raw.accel_scale is None:
        raise ConfigError(
            f"{raw.name} is in counts; name the data sheet of its sensor with --sensor."
        )
    result = resting_fits(raw)
    warnings = _told(list(logs[0].warnings) + list(result.warnings), warn)
    stated = _stated(logs[0])
    noise: dict[str, Any] = {"seconds": result.seconds, "rate_hz": raw.rate_hz}
    for term in ("white", "instability", "walk"):
        for part, sensor in ((slice(0, 3), "accel"), (slice(3, 6), "gyro")):
            fits = [getattr(result.fits[axis], term) for axis in AXES[part]]
            noise[f"{sensor}_{term}"] = [f.value for f in fits]
            noise[f"{sensor}_{term}_95"] = [[f.low, f.high] for f in fits]
    sections: Sections = {
        "accel": {"scale": stated.accel.scale, "bias": stated.accel.bias},
        "gyro": {"scale": stated.gyro.scale, "bias": stated.gyro.bias},
        "noise": noise,
        "conditions": _conditions("allan", logs, None),
    }
    page = allan_report(result, logs[0], sections, warnings)
    files = _write(out, sections, page, logs, None)
    settings = out / NOISE
    write_text(settings, _noise_settings(noise))
    summary = (
        f"{result.seconds:.0f} s at rest: gyro {np.degrees(max(noise['gyro_white'])) * 60:.3g} "
        f"deg/sqrt(h), accelerometer {max(noise['accel_white']):.3g} m/s^2/sqrt(Hz)"
    )
    return Outcome(summary, (*files, settings), tuple(warnings))


def _noise_settings(noise: dict[str, Any]) -> str:
    """Settings for ``run --config``: the worst axis of each, never below what can be seen."""
    lines = ["# Noise at rest; in a car vibration adds to the white noise.", "[fuse]"]
    for key, term in (
        ("accel_noise", "accel_white"),
        ("gyro_noise", "gyro_white"),
        ("accel_bias_walk", "accel_walk"),
        ("gyro_bias_walk", "gyro_walk"),
    ):
        value = max(noise[term])
        if value <= 0.0:
            continue  # the record shows none: the default stands
        lines.append(f"{key} = {value:.6g}")
    return "\n".join(lines) + "\n"


def _told(texts: list[str], warn: Callable[[str], None]) -> list[str]:
    unique = list(dict.fromkeys(texts))
    for text in unique:
        warn(text)
    return unique


def _conditions(kind: str, logs: list[ImuLog], gravity: float | None) -> dict[str, Any]:
    temperatures = [log.data.temp_c for log in logs if log.data.temp_c is not None]
    temperature = None
    if temperatures:
        joined = np.concatenate(temperatures)
        joined = joined[np.isfinite(joined)]
        if len(joined):
            temperature = joined
    return {
        "kind": kind,
        "gravity": gravity,
        "gyro_unit": logs[0].data.gyro_unit,
        "accel_unit": logs[0].data.accel_unit,
        "temperature_c": None if temperature is None else float(temperature.mean()),
        "temperature_span_c": None if temperature is None else float(np.ptp(temperature)),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "seconds": sum(float(log.data.t_s[-1]) for log in logs),
        "inputs": {
            str(entry["name"]): entry["sha256"]
            for entry in (_digest_entry(path) for log in logs for path in log.files)
        },
    }


def _digest_entry(path: Path) -> dict[str, str]:
    return {"name": path.name, "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}


def _write(
    out: Path,
    sections: Sections,
    page: str,
    logs: list[ImuLog],
    calibration: ImuCalibration | None,
) -> tuple[Path, ...]:
    from automap.io.atomic import make_folder, write_text
    from automap.io.imu_calibration import write_imu_calibration

    make_folder(out)
    files = [out / FILE, out / REPORT]
    write_imu_calibration(files[0], sections)
    write_text(files[1], page)
    if calibration is not None:
        for number, log in enumerate(logs):
            stem = log.files[0].stem if len(logs) == 1 else f"{number + 1}_{log.files[0].stem}"
            files.append(_write_corrected(out / f"{stem}_corrected.csv", log, calibration))
    return tuple(files)


def _write_corrected(path: Path, log: ImuLog, calibration: ImuCalibration) -> Path:
    """The log in rad/s and m/s^2, in the accelerometer's axes, as a drive can use it."""
    from automap.io.atomic import atomic_path

    raw = log.data
    gyro, accel = calibration.apply(raw.gyro, raw.accel)
    heads = ["t_ns", "gx", "gy", "gz", "ax", "ay", "az"]
    columns = [gyro, accel]
    if raw.temp_c is not None:
        heads.append("temp_c")
        columns.append(raw.temp_c[:, None])
    values = np.column_stack(columns).tolist()
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8") as stream:
        stream.write(",".join(heads) + "\n")
        for t, row in zip(raw.t_ns.tolist(), values, strict=True):
            stream.write(f"{t}," + ",".join(f"{v:.9g}" for v in row) + "\n")
    return path
