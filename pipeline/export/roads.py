"""Signs of a run, or of a merged map, onto the roads of a layer."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from automap.errors import InputError
from automap.export.roads import road_rows, set_roads
from automap.records import NO_TIME, DrivePath, FloatArray, RoadPosition, Roads, Sign, Trajectory
from pipeline.shared.products import RunProducts

if TYPE_CHECKING:
    from automap.export.roads import RoadRow
    from pipeline.export.content import MapContent

_MARGIN_DEG = 0.01
"""Round the path, some kilometre: roads that it may have gone along begin no further."""
_SHOWN = 8
"""Columns of a layer that are told, so that the right one is found."""
_TOLD = 3
"""So many signs of a kind are named in a sentence."""


def put_on_roads(content: MapContent, file: Path | None) -> list[RoadRow]:
    """Give the signs of a map their places on the roads of ``file``, and the map a warning where
    some have none or cannot be there; without a file the map has nothing of roads.

    Returns the rows. Raises InputError for a file that cannot be used.
    """
    rows: list[RoadRow] = []
    if file is not None:
        rows, told = signs_on_roads(content.products, file)
        content.warnings += told
    set_roads(content.signs, rows, content.country)
    content.warnings += odd_signs(content)
    return rows


def tried_on_roads(content: MapContent, file: Path | None) -> list[RoadRow]:
    """The same with a warning in place of InputError."""
    try:
        return put_on_roads(content, file)
    except InputError as error:
        content.warnings.append(f"Signs have no place on roads: {error}")
        return put_on_roads(content, None)


def odd_signs(content: MapContent) -> list[str]:
    """A sentence about the signs that cannot be on the roads that they are on."""
    values = content.signs.values
    odd = [
        f"{name}: {check}"
        for name, check in zip(values["id"], values.get("road_check", ()), strict=False)
        if check
    ]
    if not odd:
        return []
    more = f" and {len(odd) - _TOLD} more" if len(odd) > _TOLD else ""
    return [
        f"{len(odd)} signs are unlikely on their roads ({'; '.join(odd[:_TOLD])}{more}); look at "
        "those with a road_check."
    ]


def signs_on_roads(products: RunProducts, file: Path) -> tuple[list[RoadRow], list[str]]:
    """Rows of the signs that stand on roads of ``file``, and sentences about the others.

    Raises InputError for a file that cannot be used.
    """
    from automap.io.roads_file import read_roads
    from automap.roads.matching import road_positions

    signs = products.signs or []
    tracks = {name: t for name, t in products.trajectories.items() if len(t)}
    if not tracks:
        raise InputError("There is no trajectory, so no sign has a place on a road.")
    boxes = {name: _box(track) for name, track in tracks.items()}
    west, south, east, north = zip(*boxes.values(), strict=True)
    roads = read_roads(file, (min(west), min(south), max(east), max(north)))
    bounds = np.array([(*line.min(axis=0), *line.max(axis=0)) for line in roads.lines])
    seen = _seen(products)
    told: list[list[RoadPosition]] = [[] for _ in signs]
    off, n = 0, 0
    for name, track in tracks.items():
        near = _near(bounds, boxes[name])
        # what a reviewer put on the map stands on the road of whichever drive came by
        mine = [k for k, s in enumerate(signs) if name in s.drives or not (name and s.drives)]
        if not len(near):
            continue
        times = [seen.get((name, signs[k].id), (math.nan, math.nan)) for k in mine]
        found, matched = road_positions(
            _path(track), _some(roads, near), [signs[k] for k in mine], times
        )
        off, n = off + int((matched.segment < 0).sum()), n + len(matched.segment)
        for k, at in zip(mine, found, strict=True):
            if at is not None:
                told[k].append(_renumbered(at, near))
    positions = [_agreed(each) for each in told]
    texts = []
    if off:
        texts.append(f"{100 * off / n:.0f} % of the path are on none of its roads")
    lost = sum(at is None for at in positions)
    if lost:
        texts.append(f"{lost} of {len(signs)} signs have no place on one")
    sentences = [f"{file}: {' and '.join(texts)}."] if texts else []
    if roads.unread:
        sentences.append(
            f"{file}: which column holds the roads' keys is not known, so road_id is their row's "
            f"place in the file; give that column the name road_id (it has "
            f"{', '.join(roads.unread[:_SHOWN])})."
        )
    return road_rows(signs, positions, roads), sentences


def _agreed(told: Sequence[RoadPosition]) -> RoadPosition | None:
    """What most drives say of a sign's road and its traffic, the nearest road where several do."""
    if not told:
        return None
    votes = Counter((at.road, at.direction) for at in told)
    return min(told, key=lambda at: (-votes[at.road, at.direction], abs(at.offset_m), at.road))


def _box(track: Trajectory) -> tuple[float, float, float, float]:
    lat, lon = np.degrees(track.lat_rad), np.degrees(track.lon_rad)
    return (
        float(np.nanmin(lon)) - _MARGIN_DEG,
        float(np.nanmin(lat)) - _MARGIN_DEG,
        float(np.nanmax(lon)) + _MARGIN_DEG,
        float(np.nanmax(lat)) + _MARGIN_DEG,
    )


def _near(bounds: FloatArray, box: tuple[float, float, float, float]) -> list[int]:
    """Roads whose ``bounds`` [n, 4] touch the box."""
    west, south, east, north = box
    touch = (bounds[:, 0] <= east) & (bounds[:, 2] >= west)
    touch &= (bounds[:, 1] <= north) & (bounds[:, 3] >= south)
    return [int(k) for k in np.flatnonzero(touch)]


def _some(roads: Roads, rows: list[int]) -> Roads:
    return Roads(
        [roads.lines[k] for k in rows],
        [roads.ids[k] for k in rows],
        [roads.names[k] for k in rows],
        roads.start_m[rows],
        [roads.kind(k) for k in rows],
        roads.oneway[rows] if len(roads.oneway) else roads.oneway,
    )


def _renumbered(at: RoadPosition, rows: list[int]) -> RoadPosition:
    return RoadPosition(rows[at.road], at.chainage_m, at.offset_m, at.side, at.direction)


def _path(track: Trajectory) -> DrivePath:
    return DrivePath(
        np.asarray(track.t_ns, np.float64) * 1e-9,
        track.lat_rad,
        track.lon_rad,
        track.rpy[:, 2],
        track.sd_pos_ned[:, [1, 0, 2]],
    )


def _seen(products: RunProducts) -> Mapping[tuple[str, str], tuple[float, float]]:
    """First and last time (s of the map's stamps) that a drive, "" for a run's own, saw a sign."""
    signs: list[Sign] = products.signs or []
    if products.trajectory is not None:
        return {("", s.id): (_seconds(s.first_seen_ns), _seconds(s.last_seen_ns)) for s in signs}
    table = products.observations
    if table is None or not {"drive", "sign_id", "t_ns"} <= set(table.column_names):
        return {}
    found: dict[tuple[str, str], tuple[float, float]] = {}
    drives, ids = table["drive"].to_pylist(), table["sign_id"].to_pylist()
    stamps = np.asarray(table["t_ns"].to_numpy(), np.float64) * 1e-9
    for drive, name, t in zip(drives, ids, stamps.tolist(), strict=True):
        first, last = found.get((drive, name), (t, t))
        found[drive, name] = (min(first, t), max(last, t))
    return found


def _seconds(stamp: int) -> float:
    return math.nan if stamp == NO_TIME else stamp * 1e-9
