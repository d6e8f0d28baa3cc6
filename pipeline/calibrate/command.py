"""``automap calibrate``: logs in, calibration file, report and corrected logs out."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from automap.calibration.fold import angles, corrected, folded_covariance
from automap.errors import ConfigError
from automap.records import ImuCalibration, TriadCalibration
from pipeline.calibrate.logs import LogSource, local_gravity, read_logs, stated
from pipeline.calibrate.output import Outcome, Sections, conditions, digest_entry, write

if TYPE_CHECKING:
    from automap.calibration.dynamic import DynamicCalibration
    from automap.calibration.static import StaticCalibration

NOISE = "noise.toml"


def _say(text: str) -> None:
    print(f"warning: {text}", file=sys.stderr)


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
    from pipeline.calibrate.report import static_report

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
        "conditions": conditions("static", logs, g),
    }
    if result.left_out is not None:
        sections["accel"]["left_out_rms"] = result.left_out.rms
    calibration = ImuCalibration(
        TriadCalibration(accel.scale, accel.bias, accel.matrix),
        TriadCalibration(*(sections["gyro"][k] for k in ("scale", "bias", "matrix"))),
        g_sensitivity=chosen.g_sensitivity if chosen else np.zeros((3, 3)),
    )
    page = static_report(result, logs, sections, warnings)
    files = write(out, sections, page, logs, calibration if apply else None)
    return Outcome(_static_summary(result, g, place), files, tuple(warnings))


def _static_summary(
    result: StaticCalibration, gravity: float, place: tuple[float, float] | None
) -> str:
    # a longitude in place of the height is seen here
    where = f" at latitude {place[0]:g}, {place[1]:g} m above the sea" if place else ""
    text = (
        f"{len(result.accel.residuals)} rest poses, norm within "
        f"{result.accel.residual_rms:.5f} m/s^2 RMS of gravity ({gravity:.5f}{where})"
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
    from automap.calibration.dynamic import calibrate_dynamic
    from automap.calibration.limits import PRIOR_SD, TURN_ON_SD
    from automap.calibration.plausible import refuse_saturation
    from automap.io.imu_calibration import read_imu_calibration
    from pipeline.calibrate.report import dynamic_report

    logs = read_logs(source)
    if len(logs) > 1:
        raise ConfigError("a dynamic calibration takes one log, of one turn-on.")
    log = logs[0].data
    refuse_saturation(log)
    g, warnings = local_gravity(gravity, place)
    before = stated(logs[0]) if calibration is None else read_imu_calibration(calibration)
    gyro, accel = before.apply(log.gyro, log.accel)
    prior = PRIOR_SD if calibration is None else TURN_ON_SD
    result = calibrate_dynamic(log, gyro, accel, g, prior)
    warnings = _told(list(logs[0].warnings) + warnings + list(result.warnings), warn)
    after = corrected(before, result.final)
    names = ("scale", "bias")
    sections: Sections = {
        "accel": {
            **{k: getattr(after.accel, k) for k in names},
            "misalignment": angles(after.accel.matrix),
            "covariance": folded_covariance(before.accel, result.covariance, (0, 6), 9),
        },
        "gyro": {
            **{k: getattr(after.gyro, k) for k in names},
            "matrix": after.gyro.matrix,
            "g_sensitivity": after.g_sensitivity if np.any(after.g_sensitivity) else None,
            "covariance": folded_covariance(before.gyro, result.covariance, (3, 9), 12),
        },
        "dynamic": _dynamic_section(result),
        "conditions": conditions("dynamic", logs, g),
    }
    if calibration is not None:
        sections["conditions"]["after"] = digest_entry(calibration)
    page = dynamic_report(result, logs[0], gyro, accel, sections, warnings)
    files = write(out, sections, page, logs, after if apply else None)
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


def allan(source: LogSource, out: Path, warn: Callable[[str], None] = _say) -> Outcome:
    """``calibrate allan``: white noise, bias instability and random walk of a resting log."""
    from automap.calibration.allan_triads import AXES, resting_fits
    from automap.io.atomic import write_text
    from pipeline.calibrate.report import allan_report

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
    sheet = stated(logs[0])
    noise: dict[str, Any] = {"seconds": result.seconds, "rate_hz": raw.rate_hz}
    for term in ("white", "instability", "walk"):
        for part, sensor in ((slice(0, 3), "accel"), (slice(3, 6), "gyro")):
            fits = [getattr(result.fits[axis], term) for axis in AXES[part]]
            noise[f"{sensor}_{term}"] = [f.value for f in fits]
            noise[f"{sensor}_{term}_95"] = [[f.low, f.high] for f in fits]
    sections: Sections = {
        "accel": {"scale": sheet.accel.scale, "bias": sheet.accel.bias},
        "gyro": {"scale": sheet.gyro.scale, "bias": sheet.gyro.bias},
        "noise": noise,
        "conditions": conditions("allan", logs, None),
    }
    page = allan_report(result, logs[0], sections, warnings)
    files = write(out, sections, page, logs, None)
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
