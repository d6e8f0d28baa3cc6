"""The section on clocks: how host time was tied to GPS time, and how well."""

from __future__ import annotations

from typing import Any

import numpy as np

from automap.io import names
from automap.io.clock_json import read_clock
from automap.records import FloatArray
from pipeline.pages.section import Section, draw_over_time
from pipeline.pages.svg_plot import Series, thin_dots
from pipeline.report.figures import metres_text
from pipeline.shared.products import RunProducts

METHODS = {
    "arrival": "The host clock was tied to GPS time by the arrival times of the receiver's data.",
    "identity": "The recording's stamps are GPS time already; nothing had to be estimated.",
    "unix": "The recording's stamps are UTC; leap seconds were added.",
    "correlation": "There are no arrival times, so the host clock was tied to GPS time by "
    "matching the motion seen by the IMU with the motion seen by the receiver.",
}

DELAY_DOTS = 4000


def sync_section(products: RunProducts) -> Section:
    """Offset, drift and their uncertainty in words, all figures, and the delays."""
    section = Section(header=("figure", "value"), folded="All figures")
    content = products.json(names.SYNC)
    clock = products.attempt(names.SYNC, read_clock)  # before the fusion mended it
    if not content or clock is None:
        section.absent = "The clocks of this drive were not tied to each other."
        return section
    method = str(content.get("method", ""))
    section.sentences.append(METHODS.get(method, f"The clock was found by: {method}."))
    if method not in ("identity", "unix"):
        section.sentences.append(_accuracy(clock.sd_offset_s, clock.drift, clock.sd_drift))
    delay = content.get("output_delay_s")
    if isinstance(delay, int | float):
        section.sentences.append(
            f"The receiver hands its data out {delay * 1e3:.0f} ms after the epoch at the least."
        )
    elif method == "arrival":
        section.sentences.append(
            "The receiver's own output delay is not given; the fusion estimates it."
        )
    imu_delay, imu_sd = content.get("imu_delay_s"), content.get("imu_delay_sd_s")
    if isinstance(imu_delay, int | float) and isinstance(imu_sd, int | float):
        what = {"velocity": "velocities"}.get(str(content.get("imu_delay_source")), "positions")
        section.sentences.append(_imu_delay(imu_delay, imu_sd, what))
    section.rows = [(key.replace("_", " "), text) for key, text in _flat(content)]
    section.plots = _delay_plot(products, isinstance(delay, int | float))
    return section


def _accuracy(sd_offset_s: float, drift: float, sd_drift: float) -> str:
    rate = f"The host clock runs {abs(drift) * 1e6:.2f} ppm {'slow' if drift > 0 else 'fast'}"
    if np.isfinite(sd_drift):
        rate += f" (σ {sd_drift * 1e6:.2f} ppm)"
    if not np.isfinite(sd_offset_s):
        return (
            f"{rate}; how well its offset is known depends on the receiver's output delay, which "
            "is not known."
        )
    moved = f"at 20 m/s that is {metres_text(sd_offset_s * 20)} along the road"
    return f"{rate}; its offset is known to {sd_offset_s * 1e3:.2g} ms (1 σ): {moved}."


def _imu_delay(delay_s: float, sd_s: float, what: str) -> str:
    if abs(delay_s) < 2.0 * sd_s:
        return (
            f"By the motion that both saw, no delay between the IMU's stamps and the receiver's "
            f"{what} can be told from zero ({delay_s * 1e3:.0f} ms, σ {sd_s * 1e3:.0f} ms)."
        )
    size = f"{abs(delay_s) * 1e3:.0f} ms (σ {sd_s * 1e3:.0f} ms)"
    if delay_s > 0:
        return (
            f"By the motion that both saw, the IMU's stamps are {size} later than the receiver's "
            f"{what}; the fusion refines this."
        )
    return (
        f"By the motion that both saw, the receiver's {what} are {size} later than the IMU's "
        "stamps; the fusion refines this."
    )


def _flat(content: dict[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    rows: list[tuple[str, str]] = []
    for key, value in content.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            rows += _flat(value, f"{name}, ")
        elif isinstance(value, list):
            rows.append((name, "; ".join(str(item) for item in value[:12])))
        elif isinstance(value, float):
            rows.append((name, f"{value:.9g}" if abs(value) < 1e6 else f"{value:.6f}"))
        else:
            rows.append((name, "unknown" if value is None else str(value)))
    return rows


def _delay_plot(products: RunProducts, known: bool) -> list[Any]:
    """How late the data came: behind their epoch where the receiver's own delay is ``known``, else
    behind the earliest, whose delay arrivals do not tell."""
    table = products.table(names.SYNC_DELAYS)
    if table is None or table.num_rows == 0:
        return []
    columns: dict[str, FloatArray] = {}
    for name in table.column_names:
        kind = str(table.schema.field(name).type)
        if kind.startswith(("int", "double", "float", "bool")):
            values = table.column(name).to_numpy(zero_copy_only=False)
            columns[name] = np.asarray(values, np.float64)
    if "delay_s" not in columns:
        return []
    time_name = next((n for n in ("t_ns", "arrival_ns", "gps_s") if n in columns), None)
    if time_name is None:
        return []
    time = columns[time_name] * (1.0 if time_name == "gps_s" else 1e-9)
    seconds = time - np.nanmin(time)
    shown = thin_dots(len(seconds), DELAY_DOTS)
    # bursts of seconds would flatten the envelope that the fit rests on
    delay = columns["delay_s"] * 1e3
    ceiling = float(np.nanpercentile(delay, 98))
    series = [Series("delay", seconds[shown], np.minimum(delay[shown], ceiling), "dots", 0)]
    for name in ("envelope_s", "fit_s"):
        if name in columns:
            series.append(Series("lower envelope", seconds, columns[name] * 1e3, "line", 1))
            break
    title = "Delay from epoch to arrival" if known else "Arrival later than the earliest"
    title += " (highest 2 % cut off)"
    return draw_over_time(title, series, "ms", float(np.nanmax(seconds)))
