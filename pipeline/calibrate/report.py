"""The pages of ``automap calibrate``: one file each, works offline."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from automap.earth import STANDARD_GRAVITY
from automap.records import FloatArray
from pipeline.pages.render import sections_page
from pipeline.pages.section import AXES, Figure, Section, draw, draw_over_time
from pipeline.pages.svg_plot import Series, thin_dots

if TYPE_CHECKING:
    from automap.calibration.allan_triads import RestingFits
    from automap.calibration.dynamic import DynamicCalibration
    from automap.calibration.static import StaticCalibration
    from automap.io.imu_log import ImuLog

_DEG = 180.0 / np.pi
_DOTS = 4000


def static_report(
    result: StaticCalibration, logs: list[ImuLog], sections: dict[str, Any], warnings: list[str]
) -> str:
    """The page of a static calibration."""
    accel, six = result.accel, result.accel_six
    left_out = result.left_out
    figures = [
        Figure(str(len(accel.residuals)), "rest poses", "found against the log's own noise"),
        Figure(
            f"{1e3 * accel.residual_rms:.2f} mm/s²", "norm off gravity, RMS",
            f"{accel.n_parameters} parameters; {1e3 * six.residual_rms:.2f} with the paper's 6",
        ),
    ]  # fmt: skip
    if left_out is not None:
        figures.append(
            Figure(f"{1e3 * left_out.rms:.2f} mm/s²", "the same, pose left out", "leave-one-out")
        )
    for fit, note in (
        (result.gyro, "scale, misalignment"),
        (result.gyro_with_g, "and g-sensitivity"),
    ):
        if fit is not None:
            figures.append(Figure(f"{_DEG * fit.turn_rms:.3f}°", "gravity after a turn, RMS", note))
    parts = [
        ("Accelerometer", _accel_section(result)),
        ("Gyro", _gyro_section(result)),
        ("Rests", _rest_section(result, logs)),
    ]
    return _page("Static calibration", logs, figures, parts, sections, warnings)


def _accel_section(result: StaticCalibration) -> Section:
    accel, six = result.accel, result.accel_six
    number = np.arange(1.0, len(accel.residuals) + 1.0)
    series = [Series(f"{accel.n_parameters} parameters", number, 1e3 * accel.residuals, "dots", 0)]
    if accel.n_parameters != six.n_parameters:
        series.append(Series("6 parameters", number, 1e3 * six.residuals, "dots", 1))
    if result.left_out is not None:
        series.append(Series("pose left out", number, 1e3 * result.left_out.residuals, "dots", 2))
    section = Section(header=("", "value", "95 % ±", "unit"))
    section.plots += draw("Norm minus gravity, pose by pose", series, "mm/s²", "pose")
    if accel.n_parameters != six.n_parameters:
        section.sentences.append(
            f"Without the three angles of non-orthogonality the norm misses gravity by "
            f"{six.residual_rms:.5f} m/s² RMS, with them by {accel.residual_rms:.5f}: the "
            "difference is misalignment."
        )
    if result.left_out is not None:
        section.sentences.append(
            "Leaving out one pose changes a scale by at most "
            f"{100 * result.left_out.scale_change:.4f} %, an angle by "
            f"{1e3 * result.left_out.misalignment_change:.2f} mrad, a bias by "
            f"{1e3 * result.left_out.bias_change:.2f} mm/s²."
        )
    for i, axis in enumerate(AXES):
        section.rows.append(
            _row(f"scale {axis}", accel.scale[i], accel.half_width[i], "m/s² per unit")
        )
    for i, axis in enumerate(AXES):
        section.rows.append(_row(f"bias {axis}", accel.bias[i], accel.half_width[3 + i], "m/s²"))
    for i in range(3):
        section.rows.append(
            _row(
                f"misalignment m{i}",
                1e3 * accel.misalignment[i],
                1e3 * accel.half_width[6 + i],
                "mrad",
            )
        )
    return section


def _gyro_section(result: StaticCalibration) -> Section:
    gyro, with_g = result.gyro, result.gyro_with_g
    if gyro is None:
        return Section(absent="The turns do not determine the gyro; its scale is the data sheet's.")
    number = np.arange(1.0, len(gyro.turn_errors) + 1.0)
    series = [Series("scale and misalignment", number, _DEG * gyro.turn_errors, "dots", 0)]
    section = Section(header=("", "value", "95 % ±", "unit"))
    section.sentences.append(
        f"Leaving out one turn changes a scale by at most {100 * gyro.scale_change:.3f} %, an "
        f"angle by {1e3 * gyro.matrix_change:.2f} mrad."
    )
    if with_g is not None:
        series.append(Series("with g-sensitivity", number, _DEG * with_g.turn_errors, "dots", 1))
        largest = _DEG * STANDARD_GRAVITY * float(np.abs(with_g.g_sensitivity).max())
        width = _DEG * STANDARD_GRAVITY * float(with_g.half_width[12:].max())
        section.sentences.append(
            f"With g-sensitivity (largest term {largest:.4f} ± {width:.4f} deg/s per g) gravity "
            f"arrives within {_DEG * with_g.turn_rms:.3f} deg, not {_DEG * gyro.turn_rms:.3f}."
        )
    section.plots += draw("Gravity carried through a turn, off by", series, "deg", "turn", (0.0,))
    for i, axis in enumerate(AXES):
        section.rows.append(
            _row(f"scale {axis}", gyro.scale[i], gyro.half_width[i], "rad/s per unit")
        )
    for i, axis in enumerate(AXES):
        section.rows.append(
            _row(f"bias {axis}", _DEG * gyro.bias[i], _DEG * gyro.half_width[3 + i], "deg/s")
        )
    places = [(a, b) for a in range(3) for b in range(3) if a != b]
    for i, (a, b) in enumerate(places):
        section.rows.append(
            _row(
                f"misalignment {AXES[a]}{AXES[b]}", 1e3 * gyro.matrix[a, b],
                1e3 * gyro.half_width[6 + i], "mrad",
            )
        )  # fmt: skip
    return section


def _rest_section(result: StaticCalibration, logs: list[ImuLog]) -> Section:
    search = result.search
    section = Section(header=("limit on variance over noise", "rests"), folded="Limits tried")
    section.sentences.append(
        f"Rest is where the variance in half a second stays below {search.limit:.1f} times the "
        f"noise floor ({search.gyro_limit:.1f} for the gyro): of the limits tried, the one that "
        "leaves the parameters' intervals narrowest."
    )
    section.rows = [(f"{limit:.1f}", str(count)) for limit, count in search.tried]
    for number, log in enumerate(logs):
        force = np.linalg.norm(result.accel.apply(log.data.accel), axis=1)
        t_s = log.data.t_s
        rest = np.full(len(t_s), np.nan)
        for r in search.rests:
            if r.log == number:
                rest[r.start : r.stop] = result.gravity
        some = thin_dots(len(t_s), _DOTS)
        series = [
            Series("specific force", t_s, force, "line", 0),
            Series("rests", t_s[some], rest[some], "dots", 1),
        ]
        section.plots += draw_over_time(f"Norm of {log.data.name}", series, "m/s²", float(t_s[-1]))
    return section


def dynamic_report(
    result: DynamicCalibration,
    log: ImuLog,
    gyro: FloatArray,
    accel: FloatArray,
    sections: dict[str, Any],
    warnings: list[str],
) -> str:
    """The page of a dynamic calibration; ``gyro``, ``accel`` [n, 3] the conditioned readings."""
    from automap.calibration.dynamic import ERROR_NAMES

    final, sd = result.final, result.sd[-1]
    accel_bias, gyro_bias = (float(np.abs(final[k : k + 3]).max()) for k in (0, 3))
    figures = [
        Figure(f"{_DEG * gyro_bias:.3f} °/s", "largest gyro bias", "correction"),
        Figure(f"{accel_bias:.3f} m/s²", "largest accelerometer bias", "correction"),
        Figure(f"{result.hand_velocity:.2f} m/s", "velocity of the hand, RMS", "should be small"),
        Figure(f"{_DEG * float(result.turned.min()):.0f}°", "least turned axis", "in all"),
    ]  # fmt: skip
    errors = Section(header=("", "value", "σ", "unit"))
    groups = (
        ("Accelerometer bias", 0, 1.0, "m/s²"),
        ("Gyro bias", 3, _DEG, "deg/s"),
        ("Accelerometer scale", 6, 100.0, "%"),
        ("Gyro scale", 9, 100.0, "%"),
    )
    t_s, some = result.t_s, thin_dots(len(result.t_s), _DOTS)
    for title, first, factor, unit in groups:
        series = []
        for i, axis in enumerate(AXES):
            value, width = (factor * a[some, first + i] for a in (result.errors, result.sd))
            series.append(Series("", t_s[some], value - width, "band", i, value + width))
            series.append(Series(axis, t_s[some], value, "line", i))
            errors.rows.append(
                _row(
                    ERROR_NAMES[first + i], factor * final[first + i], factor * sd[first + i], unit
                )
            )
        errors.plots += draw_over_time(title, series, unit, float(t_s[-1]))
    parts = [
        ("Errors over time (corrections, one σ)", errors),
        ("Roll and pitch at rest", _attitude_section(result, log, gyro, accel)),
        ("Pseudo-velocity", _innovation_section(result)),
    ]
    return _page("Dynamic calibration", [log], figures, parts, sections, warnings)


def _attitude_section(
    result: DynamicCalibration, log: ImuLog, gyro: FloatArray, accel: FloatArray
) -> Section:
    """Figure 2 of the paper on the rests of this log."""
    from automap.calibration.rest import movement, rests_below
    from automap.calibration.rest_attitude import rest_attitude, roll_pitch_since_start

    rests = rests_below([log.data], [movement(log.data)], 8.0)
    rests = sorted(rests, key=lambda r: r.length_s)[-10:]
    if not rests:
        return Section(absent="The log has no rest of a second or more.")
    e = result.final
    after = ((1.0 + e[9:]) * gyro + e[3:6], (1.0 + e[6:9]) * accel + e[:3])
    section = Section(header=("rest", "length, s", "drift before, deg", "after, deg"))
    series: dict[str, list[Series]] = {"without": [], "with": []}
    for k, rest in enumerate(sorted(rests, key=lambda r: r.start)):
        rows = slice(rest.start, rest.stop)
        t_s = log.data.t_s[rows]
        drifts = []
        for key, (w, f) in (("without", (gyro, accel)), ("with", after)):
            attitude = rest_attitude(t_s, w[rows], f[rows])
            turned = _DEG * roll_pitch_since_start(attitude.down)
            for i in range(2):
                series[key].append(Series("", attitude.t_s, turned[:, i], "line", k % 8))
            drifts.append(f"{_DEG * attitude.drift:.3f}")
        section.rows.append((f"{k + 1}", f"{rest.length_s:.1f}", *drifts))
    limits = [float(np.abs(s.y).max()) for s in series["without"]]
    span = max(limits)
    for key, title in (("without", "Without dynamic calibration"), ("with", "With it")):
        length = max(float(s.x[-1]) for s in series[key])
        section.plots += draw_over_time(
            title, series[key], "roll and pitch, deg", length, (-span, span)
        )
    section.sentences.append(
        "Roll and pitch integrated from the gyro over the longest rests, from their start."
    )
    return section


def _innovation_section(result: DynamicCalibration) -> Section:
    section = Section()
    rows = result.innovations[:, 0].astype(np.int64)
    t_s = result.t_s[rows]
    series = [
        Series(part, t_s, result.innovations[:, 1 + i], "dots", i)
        for i, part in enumerate(("north", "east", "down"))
    ]
    section.plots += draw_over_time(
        "Velocity that should be zero", series, "m/s", float(result.t_s[-1])
    )
    inside = np.abs(result.innovations[:, 1:4]) < 2.0 * result.innovations[:, 4:7]
    section.sentences.append(
        f"The hand moved by {result.hand_velocity:.2f} m/s and {result.hand_place:.2f} m RMS; "
        f"{100 * inside.mean():.0f} % of the innovations lie within two σ."
    )
    return section


def allan_report(
    result: RestingFits, log: ImuLog, sections: dict[str, Any], warnings: list[str]
) -> str:
    """The page of an Allan deviation."""
    figures = [Figure(f"{result.seconds:.0f} s", "at rest", f"from {result.start_s:.0f} s on")]
    parts = []
    for sensor, title, factor, units in (
        ("gyro", "Gyro", _DEG, ("deg/s/√Hz", "deg/s", "deg/s/√s")),
        ("accel", "Accelerometer", 1.0, ("m/s²/√Hz", "m/s²", "m/s²/√s")),
    ):
        section = Section(header=("", "value", "95 % from", "to", "unit"))
        for i, axis in enumerate(AXES):
            fit = result.fits[f"{sensor}_{axis}"]
            x = np.log10(fit.tau_s)
            series = [
                Series("", x, factor * fit.low, "band", i, factor * fit.high),
                Series("measured", x, factor * fit.deviation, "line", i),
                Series("fitted", x, factor * fit.fitted, "line", "quiet"),
            ]
            section.plots += draw(
                f"{title} {axis}", series, units[1], "log10 of averaging time, s", log=True
            )
            for name, term, unit in (
                ("white noise", fit.white, units[0]),
                ("bias instability", fit.instability, units[1]),
                ("random walk", fit.walk, units[2]),
            ):
                values = (factor * v for v in (term.value, term.low, term.high))
                section.rows.append((f"{name} {axis}", *(f"{v:.4g}" for v in values), unit))
        parts.append((title, section))
        white = factor * max(result.fits[f"{sensor}_{a}"].white.value for a in AXES)
        figures.append(
            Figure(f"{white:.3g} {units[0]}", f"white noise, {title.lower()}", "worst axis")
        )
    return _page("Noise at rest", [log], figures, parts, sections, warnings)


def _row(name: str, value: float, width: float, unit: str) -> tuple[str, ...]:
    digits = 6 if width <= 0 else int(np.clip(np.ceil(np.log10(abs(value) / width + 1)) + 2, 3, 9))
    return name, f"{value:.{digits}g}", f"{width:.2g}", unit


def _page(
    title: str,
    logs: list[ImuLog],
    figures: list[Figure],
    parts: list[tuple[str, Section]],
    sections: dict[str, Any],
    warnings: list[str],
) -> str:
    conditions = sections["conditions"]
    facts = [(key, str(value)) for key, value in conditions.items() if value is not None]
    name = ", ".join(log.data.name for log in logs)
    return sections_page(title, name, figures, parts, warnings, facts)
