"""The data dictionary that is shipped with a map: every column with its unit and meaning."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

from automap.export.assemblies import ASSEMBLY_FIELDS
from automap.export.fields import ROAD_FIELDS, SIGN_FIELDS, STAMP_FIELDS, Field
from automap.io import names

POSITION_FIELDS: tuple[Field, ...] = (
    Field("lon_deg", "real", "deg", "longitude, WGS-84 unless the file names another datum", 9),
    Field("lat_deg", "real", "deg", "latitude", 9),
    Field("height_m", "real", "m", "height above the ellipsoid", 3),
)


def plane_fields(crs: str) -> tuple[Field, ...]:
    """The columns of projected coordinates, in the system ``crs`` and its own units."""
    return (
        Field("easting", "real", "", f"easting in {crs}, in its unit", 3),
        Field("northing", "real", "", f"northing in {crs}, in its unit", 3),
        Field("crs_height", "real", "", f"height in {crs}; above the ellipsoid if it has none", 3),
        Field("crs", "text", "", "code of the system of easting, northing and crs_height"),
    )


TRACK_FIELDS: tuple[Field, ...] = (
    Field("t_ns", "integer", "ns", "host clock at the start of the line"),
    Field("utc", "time", "UTC", "time at the start of the line"),
    Field("speed_m_s", "real", "m/s", "speed"),
    Field("roll_deg", "real", "deg", "roll of the vehicle, right side down is positive"),
    Field("pitch_deg", "real", "deg", "pitch of the vehicle, nose up is positive"),
    Field("yaw_deg", "real", "deg", "heading of the vehicle, clockwise from north"),
    Field("sd_h_m", "real", "m", "standard deviation of the horizontal position, north and east "
          "together"),
    Field("sd_d_m", "real", "m", "standard deviation of the height"),
)  # fmt: skip

OBSERVATION_FIELDS: tuple[Field, ...] = (
    Field("camera", "text", "", "name of the camera"),
    Field("frame", "integer", "", "number of the frame, from 0 over all chapters"),
    Field("t_ns", "integer", "ns", "stamp of the frame, time offset of the camera not applied"),
    Field("utc", "time", "UTC", "time of the frame"),
    Field("class", "text", "", "class of the sign face, by all views of its track"),
    Field("view_class", "text", "", "class that this view alone looks like"),
    Field("x_min", "real", "px", "left edge of the box; pixel centres are integers"),
    Field("y_min", "real", "px", "upper edge of the box"),
    Field("x_max", "real", "px", "right edge of the box"),
    Field("y_max", "real", "px", "lower edge of the box"),
    Field("score", "real", "", "the detector's belief in the box, 0 to 1"),
    Field("detector_track", "integer", "", "number of the track that the detector linked, -1 none"),
    Field("contrast", "real", "", "contrast of the face in this view, 0 to 1"),
    Field("contrast_note", "text", "", "why it could not be measured"),
    Field("track", "integer", "", "number of the pass in which the sign was seen, -1 none"),
    Field("sign_id", "text", "", "sign that the detection belongs to"),
    Field("residual_x_px", "real", "px", "measured minus expected direction, right is positive"),
    Field("residual_y_px", "real", "px", "measured minus expected direction, down is positive"),
    Field("range_m", "real", "m", "distance from the camera to the sign"),
    Field("used", "integer", "", "whether the position of the sign rests on it"),
    Field("note", "text", "", "why it was not used"),
)

SIGN_ROAD_FIELDS: tuple[Field, ...] = (
    Field("sign_id", "text", "", "sign that stands on the road"),
    *(f for f in ROAD_FIELDS if f.name != "road_check"),
    Field("lon_deg", "real", "deg", "where the sign stood when it was put there", 7),
    Field("lat_deg", "real", "deg", "where the sign stood when it was put there", 7),
)

LAYERS: tuple[tuple[str, str, Sequence[Field]], ...] = (
    ("signs", "points where the signs stand", (*SIGN_FIELDS, *ROAD_FIELDS, *STAMP_FIELDS)),
    ("ellipses", "outlines that hold a sign's horizontal position with 95 % probability",
     (*SIGN_FIELDS, *ROAD_FIELDS, *STAMP_FIELDS)),
    ("assemblies", "posts and gantries with what hangs on them", ASSEMBLY_FIELDS),
    ("trajectory", "the driven path in short lines", TRACK_FIELDS),
    ("observations", "every detection, at the vehicle's place", OBSERVATION_FIELDS),
)  # fmt: skip
"""Layer of the GeoPackage, what its features are, its columns."""

TRAJECTORY_COLUMNS: tuple[Field, ...] = (
    Field("t_ns", "integer", "ns", "host clock, the IMU's stamp unchanged"),
    Field("gps_s", "real", "s", "GPS time since 1980-01-06, our best for the stamp"),
    Field("lat_deg", "real", "deg", "latitude of the IMU"),
    Field("lon_deg", "real", "deg", "longitude of the IMU"),
    Field("height_m", "real", "m", "height above the ellipsoid"),
    *(Field(f"v{a}", "real", "m/s", f"velocity {b}") for a, b in zip("ned", (
        "north", "east", "down"), strict=True)),
    Field("roll_deg", "real", "deg", "roll, right side down is positive"),
    Field("pitch_deg", "real", "deg", "pitch, nose up is positive"),
    Field("yaw_deg", "real", "deg", "heading, clockwise from north"),
    *(Field(f"sd_{a}_m", "real", "m", f"standard deviation of the position {b}")
      for a, b in zip("ned", ("north", "east", "down"), strict=True)),
    *(Field(f"sd_v{a}", "real", "m/s", f"standard deviation of the velocity {b}")
      for a, b in zip("ned", ("north", "east", "down"), strict=True)),
    *(Field(f"sd_{a}_deg", "real", "deg", f"standard deviation of {a}")
      for a in ("roll", "pitch", "yaw")),
    Field("sd_slip_deg", "real", "deg", "what sd_yaw_deg has in it for a nose that is off its "
          "course for minutes; empty where unknown"),
)  # fmt: skip

PICTURE_FIELDS: tuple[Field, ...] = (
    Field("file", "text", "", "picture in the folder pictures"),
    Field("sign_id", "text", "", "sign that it shows"),
    Field("rank", "integer", "", "1 is the nearest view"),
    Field("camera", "text", "", "name of the camera"),
    Field("frame", "integer", "", "number of the frame"),
    Field("t_ns", "integer", "ns", "stamp of the frame"),
    *(Field(f"{a}_{b}", "real", "px", "edge of the box in the frame")
      for b in ("min", "max") for a in "xy"),
    Field("range_m", "real", "m", "distance from the camera to the sign"),
    Field("score", "real", "", "the detector's belief in the box, 0 to 1"),
    Field("context", "text", "", "picture of the street around the sign"),
    Field("street", "text", "", "in that picture: hidden (nobody can be recognised) or shown"),
)  # fmt: skip

_TYPES = {"text": "text", "integer": "integer", "real": "number", "time": "time", "list": "list"}


def dictionary_csv() -> str:
    """The dictionary as a table: file or layer, column, type, unit, meaning."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\r\n")
    writer.writerow(["table", "column", "type", "unit", "meaning"])
    in_files = f"{names.SIGNS_GEOJSON}, {names.SIGNS_TABLE}, {names.KML}, signs.csv, signs.fgb"
    tables: list[tuple[str, Sequence[Field]]] = [
        (in_files, SIGN_FIELDS),
        (f"{names.SIGNS_TABLE}, signs.fgb", STAMP_FIELDS),
        ("signs.csv", POSITION_FIELDS),
    ]
    tables += [(f"{names.GPKG}: {layer}", fields) for layer, _, fields in LAYERS]
    tables += [
        (f"{names.TRAJECTORY}, trajectory.csv", TRAJECTORY_COLUMNS),
        (names.OBSERVATIONS, [f for f in OBSERVATION_FIELDS if f.name != "utc"]),
        (names.PICTURE_INDEX, PICTURE_FIELDS),
        ("with a layer of roads: all tables of signs", ROAD_FIELDS),
        (names.SIGN_ROADS, SIGN_ROAD_FIELDS),
    ]
    for table, fields in tables:
        for field in fields:
            writer.writerow([table, field.name, _TYPES[field.kind], field.unit, field.meaning])
    return stream.getvalue()


def csv_metadata(
    file: str, fields: Sequence[Field], lineage: dict[str, object]
) -> dict[str, object]:
    """Description of a CSV file as the W3C's "CSV on the Web" has it, to stand beside it."""
    kinds = {"text": "string", "integer": "long", "real": "double", "time": "dateTime"}
    columns = []
    for field in fields:
        column: dict[str, object] = {
            "name": field.name,
            "titles": field.name,
            "datatype": kinds.get(field.kind, "string"),
            "dc:description": field.meaning,
        }
        if field.unit:
            column["unit"] = field.unit
        if field.kind == "list":
            column["separator"] = ";"
        columns.append(column)
    return {
        "@context": "http://www.w3.org/ns/csvw",
        "url": file,
        "dialect": {"header": True},
        "tableSchema": {"columns": columns},
        "automap": lineage,
    }
