"""The whole way from the signs of many drives to one map."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from automap.mapping.adjustment import rough_places
from automap.mapping.attributes import REJECTED
from automap.mapping.backs import backs, with_backs
from automap.mapping.by_cells import associate_by_cells
from automap.mapping.cell_merge import PlacedSigns, place_signs
from automap.mapping.cells import cell_of
from automap.mapping.drive_levels import drive_squares, error_levels
from automap.mapping.existence import Chances, DetectionRates, detection_rates, existence
from automap.mapping.grid import east_north
from automap.mapping.identity import sighting_key
from automap.mapping.sightings import DriveSigns, canonical_order, stack_sightings
from automap.records import NO_TIME, FloatArray, IntArray, Sign
from automap.records.sign_lists import SignList
from automap.signs.backs import NO_BACK

Progress = Callable[[float, str], None]


@dataclass(frozen=True, kw_only=True)
class Merged(PlacedSigns):
    """Everything that came out, in the order of the drives ``drives``.

    ``signs`` [m] of the map, the unlikely ones among them, with empty ids and with host stamps
    that are GPS time in ns; ``existence`` [m] that each stands now; ``founders`` [m] keys that
    name them and ``keys`` [m] of all their sightings. The rest are the parts they came from.
    """

    drives: list[DriveSigns]
    levels: FloatArray
    factors: FloatArray
    rates: DetectionRates
    existence: FloatArray
    signs: list[Sign]
    founders: list[str]
    keys: list[list[str]]


def merge_drives(
    drives: Sequence[DriveSigns], progress: Progress = lambda fraction, text: None
) -> Merged:
    """Associate, adjust and weigh the signs of all drives.

    The order of ``drives`` does not matter. Nothing is thrown away: what is unlikely to be
    there has a low existence.
    """
    ordered = [drives[k] for k in canonical_order(drives)]
    sightings = stack_sightings(ordered)
    sign = associate_by_cells(
        sightings, lambda done: progress(0.5 * done, "which sightings are one sign")
    )
    progress(0.5, "how large the errors are")
    homes = np.unique(cell_of(*rough_places(sightings, sign))).tolist()
    squares = [drive_squares(sightings, sign, cell) for cell in homes]
    levels, factors = error_levels(squares, len(ordered))
    placed = place_signs(
        sightings, sign, ordered, levels, factors,
        progress=lambda done: progress(0.6 + 0.2 * done, "where signs stand"),
    )  # fmt: skip
    progress(0.8, "which signs are there")
    names = [sightings.classes[code] for code in placed.attributes.code.tolist()]
    columns = {**vars(placed.attributes), **vars(placed.adjusted), "class_name": names}
    times = np.array([drive.start_gps_s for drive in ordered], np.float64)
    rates, belief, columns["n_back_views"] = weighed(columns, placed.pairs, times)
    progress(0.9, "the signs' records")
    keys: list[list[str]] = [[] for _ in names]
    members = placed.sign, placed.sightings.drive, placed.sightings.id
    for k, who, name in zip(*(column.tolist() for column in members), strict=True):
        keys[k].append(sighting_key(ordered[who], name))
    seen_by = [tuple(ordered[d].name for d in own) for own in placed.attributes.drives]
    return Merged(
        **vars(placed), drives=ordered, levels=levels, factors=factors, rates=rates,
        existence=belief, signs=list(map_signs(columns, belief, seen_by)), keys=keys,
        # the earliest, as drives come in the order of their times: later ones do not change it
        founders=[own[0] for own in keys],
    )  # fmt: skip


def weighed(
    columns: Mapping[str, Any], pairs: Chances, drive_gps_s: FloatArray
) -> tuple[DetectionRates, FloatArray, IntArray]:
    """At what rates drives at ``drive_gps_s`` [d] saw the signs of ``columns`` [m], by the
    ``pairs``; the existence [m] of each, none of what a reviewer rejected or is the back of another
    one, and the views [m] of its back."""
    rates = detection_rates(pairs, len(columns["lat"]), len(drive_gps_s))
    belief = existence(pairs, rates, len(columns["lat"]), drive_gps_s)
    lat, lon = columns["lat"], columns["lon"]
    place, plan = east_north(lat, lon, lat[:1], lon[:1]), columns["cov_enu"][:, :2, :2]
    fronts = backs(columns["class_name"], place, plan, columns["facing_rad"])
    behind = with_backs(columns["n_back_views"], columns["n_views"], fronts)
    there = (fronts == NO_BACK) & (np.asarray(columns["status"]) != REJECTED)
    return rates, np.where(there, belief, 0.0), behind


def map_signs(
    columns: Mapping[str, Any], belief: FloatArray, drives: Sequence[tuple[str, ...]]
) -> SignList:
    """Signs [m] without names, from ``columns`` [m] of places, classes and attributes, the
    ``belief`` [m] that each stands, and the names of the ``drives`` [m] that saw it."""
    sure = np.asarray(columns["class_probability"])
    # where no detector tells how sure the class is, what the boxes' scores say
    confidence = belief * np.where(
        np.isfinite(sure), sure, columns["confidence"] * columns["class_share"]
    )
    same = (
        "class_name", "height_m", "n_views", "group_probability", "side", "status",
        "height_above_road_m", "sd_above_road_m", "facing_rad", "facing_sd_rad", "size_m",
        "path_offset_m", "contrast", "contrast_sd", "contrast_note", "seen_share", "n_back_views",
    )  # fmt: skip
    called = {"height_m": "height"}
    found = {name: columns[called.get(name, name)] for name in same}
    found |= {
        "id": [""] * len(belief), "lat_rad": columns["lat"], "lon_rad": columns["lon"],
        "confidence": confidence, "existence": belief, "class_probability": sure,
        "first_seen_ns": _stamps(columns["first_gps_s"]),
        "last_seen_ns": _stamps(columns["last_gps_s"]), "drives": drives,
        "n_looked": np.asarray(columns["n_looked"], np.int64),
    }  # fmt: skip
    return SignList(found, columns["cov_enu"])


def _stamps(gps_s: FloatArray) -> IntArray:
    known = np.isfinite(gps_s)
    stamps = np.rint(np.where(known, gps_s, 0.0) * 1e9).astype(np.int64)
    return np.where(known, stamps, NO_TIME)
