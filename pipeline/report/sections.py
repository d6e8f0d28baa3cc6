"""The plotted sections of the page: clocks, innovations, uncertainty, sensor errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from automap.io import names
from automap.records import FloatArray
from pipeline.pages.section import Plot, Section, draw_over_time
from pipeline.pages.svg_plot import Series, thin_dots
from pipeline.report.channels import channel_list, channel_name, channel_order, is_rule
from pipeline.report.nis_plots import nis_series
from pipeline.shared.products import RunProducts

if TYPE_CHECKING:
    import pyarrow as pa

    from automap.effects.effect import Effect


def uncertainty_section(products: RunProducts) -> Section:
    """One-sigma of position, velocity and attitude over the drive."""
    section = Section()
    trajectory = products.trajectory
    if trajectory is None:
        section.absent = "There is no trajectory."
        return section
    seconds = (trajectory.t_ns - trajectory.t_ns[0]) * 1e-9
    degrees = np.degrees(trajectory.sd_rpy)
    triples = (
        ("Position", "σ, m", trajectory.sd_pos_ned, ("north", "east", "down")),
        ("Velocity", "σ, m/s", trajectory.sd_vel_ned, ("north", "east", "down")),
        ("Attitude", "σ, deg", degrees, ("roll", "pitch", "yaw")),
    )
    for title, label, values, parts in triples:
        section.plots += _three_lines(title, label, seconds, values, parts)
        spread = [_spread_text(values[:, i]) for i in range(3)]
        if any(spread):
            section.rows.append((title, label.removeprefix("σ, "), *spread))
    section.header = ("one σ: median (95 % below)", "unit", "north / roll", "east / pitch",
                      "down / yaw")  # fmt: skip
    if not section.plots:
        section.absent = "The trajectory tells no uncertainty."
    return section


def motion_section(products: RunProducts) -> Section:
    """Speed, with the standstill found, height and attitude over the drive."""
    section = Section()
    trajectory = products.trajectory
    if trajectory is None:
        section.absent = "There is no trajectory."
        return section
    seconds = (trajectory.t_ns - trajectory.t_ns[0]) * 1e-9
    span = float(seconds[-1])
    speed = np.hypot(trajectory.vel_ned[:, 0], trajectory.vel_ned[:, 1]) * 3.6
    top = float(np.nanmax(speed, initial=1.0))
    shades = _standstill(products, span, top)
    lines = [*shades, Series("speed" if shades else "", seconds, speed)]
    section.plots += draw_over_time("Speed", lines, "km/h", span, (0.0,))
    height = Series("", seconds, trajectory.height_m)
    section.plots += draw_over_time("Ellipsoidal height", [height], "m", span)
    roll, pitch, _ = np.degrees(trajectory.rpy).T
    tilt = [Series("roll", seconds, roll, colour=0), Series("pitch", seconds, pitch, colour=1)]
    section.plots += draw_over_time("Roll and pitch", tilt, "deg", span)
    return section


def _standstill(products: RunProducts, span: float, top: float) -> list[Series]:
    """A shade from 0 to ``top`` for every time in s at which the fusion saw the vehicle rest."""
    spans = products.json(names.FUSION).get("standstill")
    shades: list[Series] = []
    for item in spans if isinstance(spans, list) else []:
        if isinstance(item, list) and len(item) == 2 and 0 <= item[0] < item[1] <= span + 1:
            x = np.asarray(item, np.float64)
            label = "" if shades else "standing still"
            shades.append(Series(label, x, np.zeros(2), "band", 2, upper=np.full(2, top)))
    return shades


def _three_lines(
    title: str, label: str, seconds: FloatArray, values: FloatArray, parts: tuple[str, ...]
) -> list[Plot]:
    known = values[np.isfinite(values) & (values > 0)]
    if len(known) == 0:
        return []
    # an alignment that starts at degrees would flatten everything after it
    log = bool(np.percentile(known, 99.9) > 15 * np.median(known))
    series = [Series(part, seconds, values[:, i], colour=i) for i, part in enumerate(parts)]
    include = () if log else (0.0,)
    return draw_over_time(
        f"{title} {label.split(',')[0]}", series, label, float(seconds[-1]), include, log
    )


def _spread_text(values: FloatArray) -> str:
    known = values[np.isfinite(values)]
    if len(known) == 0:
        return ""
    return f"{np.median(known):.3g} ({np.percentile(known, 95):.3g})"


def sensor_section(products: RunProducts) -> Section:
    """Estimated sensor errors with their uncertainty over time."""
    from automap.effects.catalogue import CATALOGUE

    section = Section(
        header=("sensor error", "unit", "at the end", "σ at the end", f"in {names.IMU_ERRORS}")
    )
    table = products.table(names.IMU_ERRORS, ("t_ns",))
    if table is None or table.num_rows == 0:
        section.absent = "No sensor errors were estimated."
        return section
    stamps = np.asarray(table.column("t_ns").to_numpy(), np.int64)
    seconds = (stamps - stamps[0]) * 1e-9
    groups: dict[str, list[str]] = {}
    for column in table.column_names:
        if column != "t_ns" and not column.startswith("sd_"):
            groups.setdefault(_effect_of(column, tuple(CATALOGUE)), []).append(column)
    for effect, columns in groups.items():
        known = CATALOGUE.get(effect)
        title = effect.replace("_", " ") if known is None else known.summary
        parameters = [column.removeprefix(f"{effect}_") for column in columns]
        unit = "" if known is None else _unit_of(known, parameters).replace("^2", "²")
        series: list[Series] = []
        for number, (column, parameter) in enumerate(zip(columns, parameters, strict=True)):
            value, sd = _column(table, column), _column(table, f"sd_{column}")
            colour = number % 8
            if sd is not None and value is not None:
                band = Series("", seconds, value - sd, "band", colour, upper=value + sd)
                series.append(band)
            if value is not None:
                series.append(Series(parameter, seconds, value, colour=colour))
                words = f"{title}, {parameter}" if len(columns) > 1 else title
                final_sd = "" if sd is None else f"{sd[-1]:.2g}"
                section.rows.append((words, unit, f"{value[-1]:.4g}", final_sd, column))
        titled = title[:1].upper() + title[1:]
        section.plots += draw_over_time(titled, series, unit, float(seconds[-1]))
    return section


def _unit_of(effect: Effect, parameters: Sequence[str]) -> str:
    """The unit of an effect's parameters, or of what they are where it makes them wander."""
    units = {p.name: p.unit for p in effect.parameters}
    if effect.markov is not None and not units.keys() & set(parameters):
        stated = effect.terms[0].signal.startswith("position_sd")
        return "stated σ" if stated else effect.parameters[0].unit
    return next((units[p] for p in parameters if p in units), "")


def _effect_of(column: str, effects: tuple[str, ...]) -> str:
    fitting = [name for name in effects if column == name or column.startswith(f"{name}_")]
    return max(fitting, key=len) if fitting else column.rpartition("_")[0] or column


def _column(table: pa.Table, name: str) -> FloatArray | None:
    if name not in table.column_names:
        return None
    return np.asarray(table.column(name).to_numpy(), np.float64)


DOTS_PER_CHANNEL = 1500


def innovation_section(products: RunProducts) -> Section:
    """How well each kind of measurement agreed with the filter's prediction."""
    section = Section(
        header=("measurement", "number", "accepted", "mean / σ", "rms / σ", "mean NIS", "verdict")
    )
    required = ("t_ns", "channel", "innovation", "sd", "nis", "accepted")
    table = products.table(names.INNOVATIONS, required)
    if table is None or table.num_rows == 0:
        section.absent = "No measurements were compared with a prediction."
        return section
    channels = np.asarray(table.column("channel").to_pylist(), object)
    stamps = np.asarray(table.column("t_ns").to_numpy(), np.int64)
    seconds = (stamps - stamps.min()) * 1e-9
    innovation, sd, nis = (
        np.asarray(table.column(name).to_numpy(), np.float64)
        for name in ("innovation", "sd", "nis")
    )
    accepted = np.asarray(table.column("accepted").to_numpy(zero_copy_only=False), bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(sd > 0, innovation / sd, np.nan)
    span = float(seconds.max())
    loose: list[str] = []
    for channel in sorted(set(map(str, channels.tolist())), key=channel_order):
        rows = np.flatnonzero(channels == channel)
        good, bad = rows[accepted[rows]], rows[~accepted[rows]]
        section.rows.append(_channel_row(channel, ratio, nis, good, bad, section, loose))
        shown = good[thin_dots(len(good), DOTS_PER_CHANNEL)]
        refused = bad[thin_dots(len(bad), DOTS_PER_CHANNEL)]
        series = [
            Series("accepted", seconds[shown], ratio[shown], "dots", 0),
            Series("rejected", seconds[refused], np.clip(ratio[refused], -8, 8), "dots", "bad"),
        ]
        section.plots += draw_over_time(
            channel_name(channel), series, "innovation / σ", span, (-3.0, 3.0)
        )
    for title, lines in nis_series(channels, stamps, nis, accepted):
        section.plots += draw_over_time(title, lines, "NIS / m", span, (0.0, 1.0))
    if loose:
        section.verdicts.append(
            ("good", f"Held better than assumed, which is meant to be so: {channel_list(loose)}. "
             "These are rules of how cars move, taken loosely because they are never exact.")
        )  # fmt: skip
    share = float(accepted.mean())
    section.sentences.append(
        f"{share:.1%} of {len(accepted):,} measurements were accepted. An innovation is what a "
        "measurement added to the prediction; divided by its predicted σ it should scatter with "
        "an rms of 1 about zero."
    )
    shares = f"Up to {DOTS_PER_CHANNEL} points are drawn of each kind; rejected ones are cut at 8."
    section.sentences.append(shares)
    section.sentences.append(
        "NIS is the innovation of a measurement of m components, squared over its covariance: NIS "
        "/ m is 1 in the mean where the filter knows its own error. The band is where the mean of "
        "as many independent ones would lie with 95 % probability; errors that last, as those of "
        "GPS do, leave it now and then."
    )
    return section


def _channel_row(
    channel: str,
    ratio: FloatArray,
    nis: FloatArray,
    good: np.ndarray,
    bad: np.ndarray,
    section: Section,
    loose: list[str],
) -> tuple[str, ...]:
    title = channel_name(channel)
    total = len(good) + len(bad)
    share = len(good) / total
    used = ratio[good][np.isfinite(ratio[good])]
    used_nis = nis[good][np.isfinite(nis[good])]
    if len(used) == 0:
        return (title, f"{total:,}", f"{share:.1%}", "", "", "", "nothing accepted")
    rms, mean = float(np.sqrt(np.mean(used**2))), float(np.mean(used))
    words = innovation_verdict(rms, mean, share)
    if is_rule(channel) and words == _CAUTIOUS:
        words = "held better than assumed"
        loose.append(channel)
    elif words != "as expected":
        grade: Literal["fair", "bad"] = "bad" if share < 0.8 or rms > 2.0 else "fair"
        section.verdicts.append((grade, f"{title}: {words}."))
    mean_nis = f"{np.mean(used_nis):.2f}" if len(used_nis) else ""
    numbers = (f"{total:,}", f"{share:.1%}", f"{mean:+.2f}", f"{rms:.2f}", mean_nis)
    return (title, *numbers, words)


_CAUTIOUS = "scatters less than assumed, so σ are cautious"


def innovation_verdict(rms: float, mean: float, accepted: float) -> str:
    """What rms and mean of normalised innovations and the accepted share say, in words."""
    words = []
    if accepted < 0.95:
        words.append(f"{1 - accepted:.0%} were rejected as outliers")
    if rms > 1.5:
        words.append("scatters more than assumed, so σ are too small")
    elif rms < 0.5:
        words.append(_CAUTIOUS)
    if abs(mean) > 0.3 and abs(mean) > 0.3 * rms:
        words.append("is off to one side")
    return "; ".join(words) or "as expected"
