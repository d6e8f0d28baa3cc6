"""The five key figures at the head of the page."""

from __future__ import annotations

import numpy as np

from automap.export.sign_columns import SignColumns
from automap.io import names
from automap.records import FixType, FloatArray, Trajectory
from pipeline.pages.section import Figure
from pipeline.report.outages import outages
from pipeline.shared.products import RunProducts


def key_figures(products: RunProducts, signs: SignColumns) -> list[Figure]:
    """Distance, signs, horizontal uncertainty of the path and of the signs, GPS coverage."""
    return [
        _distance(products.trajectory),
        _sign_count(signs, (products.out / names.DETECTIONS).is_file() or len(signs) > 0),
        _path_sigma(products.trajectory),
        _sign_radius(signs),
        _coverage(products),
    ]


def distance_m(trajectory: Trajectory) -> float:
    """Length of the path in m, from its horizontal speed (standstill adds nothing)."""
    speed = np.hypot(trajectory.vel_ned[:, 0], trajectory.vel_ned[:, 1])
    speed = np.where(np.isfinite(speed) & (speed > 0.1), speed, 0.0)
    seconds = np.diff(trajectory.t_ns) * 1e-9
    return float(np.sum(0.5 * (speed[1:] + speed[:-1]) * seconds))


def duration_text(seconds: float) -> str:
    """A duration as h, min and s; a damaged record may tell any number."""
    if not np.isfinite(seconds):
        return "unknown"
    whole = round(seconds)
    hours, minutes, rest = whole // 3600, whole % 3600 // 60, whole % 60
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{seconds:.0f} s"


def metres_text(value: float) -> str:
    """A length with the digits that matter."""
    if value >= 1000:
        return f"{value / 1000:.2f} km" if value < 100_000 else f"{value / 1000:.0f} km"
    if value >= 10:
        return f"{value:.0f} m"
    return f"{value:.2f} m" if value >= 0.095 else f"{value * 100:.1f} cm"


def _distance(trajectory: Trajectory | None) -> Figure:
    if trajectory is None:
        return Figure("none", "path", "no trajectory could be computed")
    seconds = float(trajectory.t_ns[-1] - trajectory.t_ns[0]) * 1e-9
    return Figure(metres_text(distance_m(trajectory)), "driven", f"in {duration_text(seconds)}")


def _sign_count(signs: SignColumns, looked: bool) -> Figure:
    if not looked:
        return Figure("none", "signs", "there are no detections")
    statuses = signs.values["status"]
    good = sum(status in ("ok", "accepted", "corrected") for status in statuses)
    classes = len(set(signs.values["class"]))
    note = f"{good} without reservation, {classes} classes" if len(signs) else "none were found"
    return Figure(str(len(signs)), "signs" if len(signs) != 1 else "sign", note)


def _median_and_95(values: FloatArray) -> tuple[float, float] | None:
    known = values[np.isfinite(values)]
    if len(known) == 0:
        return None
    return float(np.median(known)), float(np.percentile(known, 95))


def _path_sigma(trajectory: Trajectory | None) -> Figure:
    name = "path, horizontal σ"
    if trajectory is None:
        return Figure("unknown", name, "no trajectory")
    spread = _median_and_95(np.hypot(trajectory.sd_pos_ned[:, 0], trajectory.sd_pos_ned[:, 1]))
    if spread is None:
        return Figure("unknown", name, "the trajectory tells no uncertainty")
    return Figure(metres_text(spread[0]), name, f"median; 95 % below {metres_text(spread[1])}")


def _sign_radius(signs: SignColumns) -> Figure:
    spread = _median_and_95(np.asarray(signs.values["ce95_m"], np.float64))
    name = "signs, 95 % radius"
    if spread is None:
        return Figure("none", name, "no sign with a known uncertainty")
    return Figure(metres_text(spread[0]), name, f"median; 95 % below {metres_text(spread[1])}")


def _coverage(products: RunProducts) -> Figure:
    fixes = products.fixes
    if fixes is None:
        return Figure("none", "GPS fixes", "the drive has no receiver log")
    good = int(np.sum(fixes.fix_type != int(FixType.NONE)))
    holes = outages(fixes)
    if not holes:
        return Figure(str(good), "GPS fixes", "no outage of more than 2 s")
    longest = max(end - start for start, end in holes)
    plural = "outage" if len(holes) == 1 else "outages"
    return Figure(str(good), "GPS fixes", f"{len(holes)} {plural}, longest {longest:.1f} s")
