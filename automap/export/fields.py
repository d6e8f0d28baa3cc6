"""The data dictionary of a sign: each field's name, type, unit and meaning, in file order.

Every format writes these fields under these names, and the report shows these meanings.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal["text", "integer", "real", "time", "list"]


@dataclass(frozen=True)
class Field:
    """One property of a sign. ``decimals`` is how many are worth writing (None: 6 digits)."""

    name: str
    kind: Kind
    unit: str
    meaning: str
    decimals: int | None = None


SIGN_FIELDS: tuple[Field, ...] = (
    Field("id", "text", "", "name of the sign within this map"),
    Field("class", "text", "", "class of the sign face"),
    Field("name", "text", "", "the class in words"),
    Field(
        "code",
        "text",
        "",
        "number of the face in the country's code, after it; else the Vienna Convention's",
    ),
    Field("value", "real", "", "number that the face shows, in value_unit", 1),
    Field("value_unit", "text", "", "unit of value: km/h or mph"),
    Field("confidence", "real", "", "existence times class_probability, 0 to 1", 3),
    Field("existence", "real", "", "probability that a sign stands there", 3),
    Field("class_probability", "real", "", "probability that the sign there is of this class", 3),
    Field("group_probability", "real", "", "probability that it has this shape and colour", 3),
    Field("n_views", "integer", "", "number of frames that the position rests on"),
    Field("first_seen", "time", "UTC", "time of the first sighting"),
    Field("last_seen", "time", "UTC", "time of the last sighting"),
    Field("height_above_road_m", "real", "m", "height of the face's centre above the road", 2),
    Field("sd_above_road_m", "real", "m", "standard deviation of height_above_road_m", 3),
    Field("height_msl_m", "real", "m", "height above mean sea level, by the receiver's geoid", 2),
    Field("facing_deg", "real", "deg", "direction the face looks, clockwise from north", 1),
    Field("facing_sd_deg", "real", "deg", "standard deviation of facing_deg", 1),
    Field("size_m", "real", "m", "height of the face", 2),
    Field("side", "text", "", "side of the road in the direction of travel"),
    Field(
        "path_offset_m",
        "real",
        "m",
        "from the path of the drive, right of it is positive; none of several drives",
        2,
    ),
    Field("support", "text", "", "post or gantry, the same for all signs on it"),
    Field(
        "face_order",
        "integer",
        "",
        "place from the top among its support's faces that look the same way, 1 the uppermost",
    ),
    Field(
        "main_sign", "text", "", "of a supplementary plate, the sign above it that it belongs to"
    ),
    Field("n_back_views", "integer", "", "views of its back in passes the other way"),
    Field("contrast", "real", "", "contrast of the face's middle, light against dark, 0 to 1", 2),
    Field("contrast_sd", "real", "", "standard deviation of contrast from view to view", 2),
    Field(
        "contrast_note",
        "text",
        "",
        "why no contrast could be measured: too small, too dark, too bright, too few views",
    ),
    Field(
        "seen_share",
        "real",
        "",
        "part of n_looked that shows it; the others have something in between, or were misread",
        2,
    ),
    Field("n_looked", "integer", "", "searched frames that the sign should be in, large enough"),
    Field("picture_file", "text", "", "file of the best picture, in the folder of the map"),
    Field("street_file", "text", "", "file of the frame around it, likewise"),
    Field("cov_ee_m2", "real", "m^2", "variance of the position east, trajectory included"),
    Field("cov_en_m2", "real", "m^2", "covariance of east and north, trajectory included"),
    Field("cov_nn_m2", "real", "m^2", "variance of the position north, trajectory included"),
    Field("sd_u_m", "real", "m", "standard deviation of the height, trajectory included", 3),
    Field("ce95_m", "real", "m", "radius that holds the position with 95 % probability", 3),
    Field("drives", "list", "", "drives that saw the sign"),
    Field("status", "text", "", "ok, or what weakens the position, or what a reviewer decided"),
    Field("note", "text", "", "what a reviewer wrote, with who and on which day"),
    Field("reviewer", "text", "", "who decided about the sign last"),
    Field("reviewed", "text", "UTC", "when that was"),
)

ROAD_FIELDS: tuple[Field, ...] = (
    Field("road_id", "text", "", "road of the layer"),
    Field("road_name", "text", "", "its name"),
    Field("road_kind", "text", "", "its kind, as the layer has it"),
    Field("chainage_m", "real", "m", "along the road, from where the layer counts", 2),
    Field("offset_m", "real", "m", "from the road's line, right of its direction is positive", 2),
    Field("road_side", "text", "", "side of the road in its digitised direction: left or right"),
    Field(
        "road_direction",
        "text",
        "",
        "traffic that the face looks at, by the digitised direction: forward or backward",
    ),
    Field("road_check", "text", "", "why such a sign cannot be on such a road, to be looked at"),
)
"""Columns beside those of ``SIGN_FIELDS`` in maps for which a layer of roads was given."""

STAMP_FIELDS: tuple[Field, ...] = (
    Field("first_seen_t_ns", "integer", "ns", "host clock at the first sighting"),
    Field("last_seen_t_ns", "integer", "ns", "host clock at the last sighting"),
)
"""Extra columns of the tabular formats, where a time column cannot hold a host stamp."""
