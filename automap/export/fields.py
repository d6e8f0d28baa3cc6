"""The data dictionary of a sign: each field's name, type, unit and meaning, in file order.

Every format writes these fields under these names, and the report shows these meanings.
"""

from __future__ import annotations

import re
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

    @property
    def title(self) -> str:
        """What people call it, without its unit."""
        bare = re.sub(r"_(m2?|deg)$", "", self.name).replace("_", " ")
        return _TITLES.get(self.name, bare)

    @property
    def unit_text(self) -> str:
        """The unit as it stands behind a number, with the space before it; none of a time, which
        says itself that it is UTC."""
        own = {"deg": "°", "m^2": " m²", "UTC": ""}
        return own.get(self.unit, f" {self.unit}" if self.unit else "")


_TITLES = {
    "class_probability": "probability of the class",
    "group_probability": "probability of shape and colour",
    "n_views": "views",
    "sd_above_road_m": "σ of height above road",
    "height_msl_m": "height above sea level",
    "facing_sd_deg": "σ of facing",
    "size_m": "height of the face",
    "path_offset_m": "offset from the path",
    "support": "post",
    "face_order": "place from the top",
    "main_sign": "plate of",
    "n_back_views": "views of its back",
    "contrast_sd": "σ of contrast",
    "contrast_note": "why no contrast",
    "seen_share": "share that shows it",
    "n_looked": "frames it should be in",
    "picture_file": "picture",
    "street_file": "picture of the street",
    "cov_ee_m2": "variance east",
    "cov_en_m2": "covariance east, north",
    "cov_nn_m2": "variance north",
    "sd_u_m": "σ of height",
    "ce95_m": "95 % radius",
    "offset_m": "offset from the road",
    "road_check": "doubt about the road",
    "sd_h_m": "σ of the place",
    "sd_d_m": "σ of height",
    "speed_m_s": "speed",
    "n_faces": "number of faces",
    "ways": "directions of its faces",
    "first_seen_t_ns": "clock at the first sighting",
    "last_seen_t_ns": "clock at the last sighting",
    "t_ns": "clock",
    "residual_x_px": "residual right",
    "residual_y_px": "residual down",
}
"""Of names that do not tell by themselves."""


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
