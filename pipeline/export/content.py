"""What goes on the map, from what the earlier stages left in OUT."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from automap.earth import MEAN_RADIUS
from automap.errors import InputError
from automap.export.path import Path as MapPath
from automap.export.path import joined_paths, simplified_path
from automap.export.pieces import Kept
from automap.export.projected import Plane
from automap.export.roads import read_roads_csv, set_roads
from automap.export.sign_columns import SignColumns, Signs, sign_columns
from automap.export.stored_signs import stored_signs
from automap.io import names
from automap.records import NO_TIME, FloatArray, Trajectory
from pipeline.export.lineage import lineage
from pipeline.shared.pictures import Picture, pictures_by_sign, read_pictures
from pipeline.shared.products import RunProducts, geoid_separation, load_products
from pipeline.shared.run_record import country_of

_GEOID_REACH_M = 1000.0
"""Plumb lines lean by less than a minute of arc, in mountains: the geoid changes by 0.3 m in that
way at most, less than what receivers' models of it are off."""


@dataclass
class MapContent:
    """What goes on the map: signs, the simplified path, and where both came from."""

    name: str
    source: Signs
    path: MapPath | None
    products: RunProducts
    warnings: list[str] = field(default_factory=list)
    every_row: bool = False
    """The trajectory's rows were asked for one by one: none is left out."""
    lineage: dict[str, Any] = field(default_factory=dict)
    """Run, versions and inputs, for the metadata of every file."""
    country: str | None = None
    pictures: list[Picture] = field(default_factory=list)
    crs: str | None = None
    """Coordinate system of the positions where it is not WGS-84."""
    plane: Plane | None = None
    """How the formats that can hold projected coordinates get them, where those are asked for."""
    geoid_m: FloatArray | None = None
    """Heights of the geoid at signs that are read part by part."""
    kept: Kept | None = None
    """Where pieces of the files are kept for the next map, and taken from an older one."""

    @property
    def signs(self) -> SignColumns:
        """The signs for what takes them all at once."""
        assert isinstance(self.source, SignColumns), "these signs are read part by part"
        return self.source


def map_content(
    out: Path,
    name: str,
    min_confidence: float = 0.0,
    on_roads: bool = True,
    fresh: bool = False,
) -> MapContent:
    """Read OUT and prepare its signs and path, with a warning for all that is missing.

    Signs of less confidence than ``min_confidence`` are left out, and counted in a warning;
    ``on_roads`` whether they are where an earlier export put them on roads; ``fresh`` as
    ``load_products`` has it.
    """
    products = load_products(out, fresh=fresh)
    left_out = _drop_unsure(products, min_confidence)
    country = country_of(products.json(names.RUN))
    signs = sign_columns(products.signs or [], products.clock, country)
    content = _content(name, signs, products)
    rows = (products.attempt(names.SIGN_ROADS, read_roads_csv) or []) if on_roads else []
    moved = set_roads(signs, rows, country)
    if moved:
        content.warnings.append(
            f"{moved} signs were moved since they were put on roads, so they have none; run the "
            "export again, or give --roads."
        )
    set_pictures(content, read_pictures(products))
    signs.values["height_msl_m"] = sea_level_heights(signs, geoid_heights(content)[0])
    if min_confidence > 0.0:
        content.lineage["min_confidence"] = min_confidence
    if left_out:
        content.warnings.append(
            f"{left_out} of {left_out + len(signs)} signs are less sure than {min_confidence:g}; "
            "they were left out."
        )
    no_path = content.path is None or not len(content.path)
    if no_path and names.TRAJECTORY not in products.lost:
        content.warnings.append("There is no trajectory, so the map shows no path.")
    if products.signs is None and names.SIGNS_RAW not in products.lost:
        content.warnings.append("No signs were located, so the map has none.")
    lost = len(signs) - int(signs.located.sum())
    if lost:
        content.warnings.append(
            f"{lost} of {len(signs)} signs have no position; they are in the files without one."
        )
    if products.clock is None and len(signs):
        content.warnings.append(
            "The recording's clock is not tied to UTC, so first_seen and last_seen are host "
            "stamps in nanoseconds."
        )
    return content


def stored_content(out: Path, name: str, kept: Kept | None = None) -> MapContent:
    """The content of a merged map whose signs are read part by part; it has no pictures, no roads
    and no review."""
    products = load_products(out, signs=False, fresh=True)
    country = country_of(products.json(names.RUN))
    signs = stored_signs(
        out / names.SIGNS_RAW, products.clock, country, geoid=bool(products.tracks)
    )
    content = _content(name, signs if kept is None else signs.keyed(), products)
    content.geoid_m = signs.geoid_m if products.tracks else None
    content.kept = kept
    return content


def _content(name: str, signs: Signs, products: RunProducts) -> MapContent:
    record = products.json(names.RUN)
    paths = {name: simplified_path(track) for name, track in products.trajectories.items()}
    path = joined_paths(paths) if products.tracks else paths.get("")
    return MapContent(
        name, signs, path, products, list(products.problems),
        lineage=lineage(record, name, products.trajectory), country=country_of(record),
    )  # fmt: skip


def set_pictures(content: MapContent, pictures: list[Picture]) -> None:
    """Give the map its pictures, and each sign the names of its best one and of its street's."""
    content.pictures = pictures
    folder = names.PICTURES
    best = {name: own[0] for name, own in pictures_by_sign(pictures).items()}
    own = [best.get(name) for name in content.signs.values["id"]]
    content.signs.values["picture_file"] = [p and f"{folder}{p.lies_at.file}" for p in own]
    content.signs.values["street_file"] = [
        f"{folder}{p.lies_at.context_file}" if p and p.context is not None else None for p in own
    ]


def _drop_unsure(products: RunProducts, least: float) -> int:
    """Take signs below a confidence off the map; a confidence that is unknown is kept."""
    if least <= 0.0 or not products.signs:
        return 0
    kept = [sign for sign in products.signs if not sign.confidence < least]
    left_out = len(products.signs) - len(kept)
    products.signs = kept
    return left_out


def geoid_heights(content: MapContent) -> tuple[FloatArray | None, FloatArray | None]:
    """Height of the geoid above the ellipsoid at the signs and along the path."""
    track = content.path
    track_geoid = None if track is None else geoid_separation(content.products, track.t_ns)
    if not isinstance(content.source, SignColumns):
        return content.geoid_m, track_geoid
    values = content.signs.values
    seen = [
        NO_TIME if first is None else (first if last is None else first + (last - first) // 2)
        for first, last in zip(values["first_seen_t_ns"], values["last_seen_t_ns"], strict=True)
    ]
    stamps = np.array(seen, np.int64)
    sign_geoid = geoid_separation(content.products, stamps)
    if sign_geoid is not None:
        sign_geoid = np.where(stamps == NO_TIME, np.nan, sign_geoid)
    elif content.products.tracks:
        told = [sign.geoid_m for sign in content.products.signs or []]
        sign_geoid = np.array(told, np.float64)
    if sign_geoid is not None:
        sign_geoid = _as_beside(content.signs, sign_geoid)
    return sign_geoid, track_geoid


def _as_beside(signs: SignColumns, geoid_m: FloatArray) -> FloatArray:
    """The geoid's heights [n]; where none is known, that at the nearest sign that has one."""
    known = np.isfinite(geoid_m) & signs.located
    wanted = np.flatnonzero(~known & signs.located)
    if not len(wanted) or not known.any():
        return geoid_m
    from scipy.spatial import KDTree

    lat, lon = np.radians(signs.lat_deg), np.radians(signs.lon_deg)
    place = MEAN_RADIUS * np.column_stack(
        [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
    )
    nearest = KDTree(place[known]).query(place[wanted], distance_upper_bound=_GEOID_REACH_M)[1]
    told = geoid_m.copy()
    # where there is none so near the index is one past the last
    told[wanted] = np.append(geoid_m[known], np.nan)[nearest]
    return told


def refuse_lost_signs(content: MapContent) -> None:
    """Raise InputError where the signs are missing or damaged, or what was decided about them:
    a map without would take the place of a right one."""
    lost = content.products.lost
    for name in (names.SIGNS_RAW, names.REVIEW):
        if name in lost:
            raise InputError(lost[name])


def trajectory_of(content: MapContent) -> Trajectory:
    """The trajectory; InputError where OUT has none."""
    trajectory = content.products.trajectory
    if content.products.tracks:
        raise InputError(
            "a merged map has the thinned tracks of several drives; give the folder of one drive, "
            "or take gpx, which holds them all."
        )
    if names.TRAJECTORY in content.products.lost and trajectory is None:
        raise InputError(content.products.lost[names.TRAJECTORY])
    if trajectory is None or len(trajectory) == 0:
        raise InputError("there is no trajectory in OUT; run the drive first.")
    return trajectory


def sea_level_heights(signs: SignColumns, geoid: FloatArray | None) -> FloatArray:
    """Heights [n] above mean sea level by the receiver's geoid, NaN where it told none."""
    if geoid is None:
        return np.full(len(signs), np.nan)
    return np.asarray(signs.height_m - geoid, np.float64)
