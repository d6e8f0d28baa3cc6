"""What the card of a sign shows: pictures, the views it rests on, where its error comes from."""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING, Any

import numpy as np

from automap.records import Sign, Trajectory, along_course
from pipeline.shared.pictures import Picture, pictures_by_sign
from pipeline.shared.products import RunProducts

if TYPE_CHECKING:
    import pyarrow as pa

PICTURE_BUDGET = 1_600_000
"""Bytes of JPEG in a page: with their base64 and all else it stays below 5 MB."""

VIEW_BUDGET = 6000
VIEWS_SHOWN = 24

Card = dict[str, Any]


def sign_cards(products: RunProducts, pictures: list[Picture], rows: list[int]) -> list[Card]:
    """A card for each of these signs (rows of ``products.signs``).

    ``pictures`` are data URIs with a caption, nearest first; ``views`` rows of seconds since
    the first sight, range (m), residual right and down (px), 1 for used; ``budget`` pairs of a
    source and the standard deviation in m that it has on the map, per axis.
    """
    signs = products.signs or []
    ids = [signs[row].id for row in rows]
    chosen, left = _within_budget(pictures_by_sign(pictures), ids)
    streets = _streets(chosen, ids, left)
    views = _views(products.observations, [signs[row] for row in rows])
    cards = []
    for row in rows:
        sign = signs[row]
        own = views.get(sign.id, [])
        cards.append(
            {
                "pictures": [_shown(picture) for picture in chosen.get(sign.id, [])]
                + streets.get(sign.id, []),
                "views": own,
                "budget": error_budget(sign, products.trajectory, own),
            }
        )
    return cards


def _shown(picture: Picture) -> dict[str, str]:
    view = picture.view
    distance = f", {view.range_m:.0f} m" if np.isfinite(view.range_m) else ""
    return {"src": _uri(picture.jpeg), "text": f"{view.camera}, frame {view.frame}{distance}"}


def _uri(jpeg: bytes) -> str:
    return "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()


def _streets(
    chosen: dict[str, list[Picture]], ids: list[str], left: int
) -> dict[str, list[dict[str, str]]]:
    """The street around the nearest view of every sign, while ``left`` bytes last."""
    streets = {}
    for sign_id in ids:
        for picture in chosen.get(sign_id, [])[:1]:
            if picture.context is None or len(picture.context) > left:
                continue
            left -= len(picture.context)
            text = f"the street, frame {picture.view.frame}"
            streets[sign_id] = [{"src": _uri(picture.context), "text": text, "wide": "1"}]
    return streets


def _within_budget(
    by_sign: dict[str, list[Picture]], ids: list[str]
) -> tuple[dict[str, list[Picture]], int]:
    """First the nearest view of every sign, then the second ones, while there is room; and how
    many bytes are left."""
    chosen: dict[str, list[Picture]] = {}
    size = 0
    most = max((len(own) for own in by_sign.values()), default=0)
    for rank in range(most):
        for sign_id in ids:
            own = by_sign.get(sign_id, [])
            if rank >= len(own):
                continue
            if size + len(own[rank].jpeg) > PICTURE_BUDGET:
                return chosen, 0
            size += len(own[rank].jpeg)
            chosen.setdefault(sign_id, []).append(own[rank])
    return chosen, PICTURE_BUDGET - size


def _views(observations: pa.Table | None, signs: list[Sign]) -> dict[str, list[list[float | None]]]:
    wanted = ("sign_id", "t_ns", "range_m", "residual_x_px", "residual_y_px", "used")
    if observations is None or any(name not in observations.column_names for name in wanted):
        return {}
    ids = observations.column("sign_id").to_pylist()
    t_ns = np.asarray(observations.column("t_ns").to_numpy(), np.int64)
    numbers = [np.asarray(observations.column(name).to_numpy(), np.float64) for name in wanted[2:5]]
    used = np.asarray(observations.column("used").to_numpy(), bool)
    known = {sign.id for sign in signs}
    rows_of: dict[str, list[int]] = {}
    for row, sign_id in enumerate(ids):
        if sign_id in known:
            rows_of.setdefault(sign_id, []).append(row)
    most = max(3, min(VIEWS_SHOWN, VIEW_BUDGET // max(len(signs), 1)))
    views = {}
    for sign_id, own in rows_of.items():
        rows = np.array(own)[np.argsort(t_ns[own], kind="stable")]
        # evenly spread, the first and the last among them
        rows = rows[
            np.unique(np.linspace(0, len(rows) - 1, min(len(rows), most)).round().astype(int))
        ]
        start = int(t_ns[rows[0]])
        views[sign_id] = [
            [round((int(t_ns[row]) - start) * 1e-9, 2)]
            + [_number(column[row]) for column in numbers]
            + [int(used[row])]
            for row in rows.tolist()
        ]
    return views


def _number(value: float) -> float | None:
    return round(float(value), 2) if np.isfinite(value) else None


def error_budget(
    sign: Sign, trajectory: Trajectory | None, views: list[list[float | None]]
) -> list[tuple[str, float]]:
    """Sources of a sign's horizontal error, each with its standard deviation per axis in m.

    The path's share is its own sigma at the last sight; the heading's that of the yaw over the
    nearest range; what is left of the total comes from pixels, size and mounting of the camera.
    Empty where the sign has no covariance.
    """
    variance = 0.5 * float(sign.cov_enu[0, 0] + sign.cov_enu[1, 1])
    if not np.isfinite(variance) or variance < 0:
        return []
    budget: list[tuple[str, float]] = []
    left = variance
    row = _row_at(trajectory, sign.last_seen_ns)
    if trajectory is not None and row is not None:
        position = 0.5 * float((trajectory.sd_pos_ned[row, :2] ** 2).sum())
        ranges = [view[1] for view in views if view[1] is not None and view[4]]
        nearest = min(ranges, default=0.0)
        sd_rpy = along_course(trajectory.sd_rpy[[row]], trajectory.slip_sd[[row]])
        turned = 0.5 * float((sd_rpy[0, 2] * nearest) ** 2)
        for label, part in (("position of the vehicle", position), ("its heading", turned)):
            if np.isfinite(part) and part > 0:
                budget.append((label, _rounded(part)))
                left -= part
    if budget:
        budget.append(("pixels, size, camera mounting", _rounded(max(left, 0.0))))
    return [*budget, ("all together", _rounded(variance))]


def _rounded(variance: float) -> float:
    return round(float(np.sqrt(variance)), 2)


def _row_at(trajectory: Trajectory | None, t_ns: int) -> int | None:
    if trajectory is None or len(trajectory) == 0:
        return None
    if not trajectory.t_ns[0] <= t_ns <= trajectory.t_ns[-1]:
        return None
    return min(int(np.searchsorted(trajectory.t_ns, t_ns)), len(trajectory) - 1)
