"""Why a file of a folder is no recording that can be used, in a sentence for its owner."""

from __future__ import annotations

from pathlib import Path

from automap.errors import AutoMapError
from automap.io.csv_layout import read_layout
from automap.io.header_names import HeaderName, meaning, take_apart, triad_axis
from automap.io.named_table import look_at_table

_PROJECTED = {
    "easting",
    "eastings",
    "northing",
    "northings",
    "rechtswert",
    "hochwert",
    "utm",
    "ost",
}
_ANGLES = {"roll", "pitch", "yaw", "azimuth"}
_KINDS_OF_ROW = {"sensor", "type", "name", "kind", "channel", "signal"}
_SHOWN = 8
ALONE = " and no other table does at the same times"


def tells_places(path: Path) -> bool:
    """Whether the columns of a table that can be read are named as places are."""
    names = [take_apart(name).words for name in read_layout(path).names]
    ideas = {idea for words in names for idea in meaning(words, "gnss").ideas}
    projected = {word for words in names for word in words} & _PROJECTED
    return {"lat", "lon"} <= ideas or len(projected) > 1


def why_not(path: Path) -> str:
    """What to do about a table that is none of ours."""
    try:
        layout = read_layout(path)
    except AutoMapError as error:
        return str(error).removeprefix(f"{path} ").removeprefix(f"{path}: ").rstrip(".")
    names = tuple(take_apart(name) for name in layout.names)
    words = {word for name in names for word in name.words}
    triads = [found for found in map(triad_axis, names) if found is not None]
    has = {sensor for sensor, _, _ in triads}
    place = {idea for name in names for idea in meaning(name.words, "gnss").ideas}
    if {"lat", "lon"} <= place or has == {"g", "a"}:
        return _refused(path, "gnss" if {"lat", "lon"} <= place else "imu")
    if len(words & _PROJECTED) > 1:
        return (
            "it holds eastings and northings; convert them to latitude and longitude (WGS-84, with "
            "QGIS or cs2cs), for the zone is not in them"
        )
    if has == {"a"} and words & _ANGLES:
        return (
            "it holds angles (roll, pitch, yaw) in place of turn rates; record the gyroscope's own"
        )
    if has:
        other = "turn rates" if has == {"a"} else "accelerations"
        return f"it holds no {other}{ALONE}"
    if words & _KINDS_OF_ROW and _columns(names, "x y z"):
        return (
            "each of its rows is of one sensor; write a table with a time, gx, gy, gz, ax, ay, az "
            "in each row"
        )
    found = ", ".join(name for name in layout.names[:_SHOWN] if name)
    return f"its columns say nothing that is known ({found})"


def _columns(names: tuple[HeaderName, ...], wanted: str) -> bool:
    return set(wanted.split()) <= {word for name in names for word in name.words}


def _refused(path: Path, kind: str) -> str:
    """Why a table that has the columns of a kind cannot be read as it."""
    try:
        guess = look_at_table(path, "imu" if kind == "imu" else "gnss")
    except AutoMapError as error:
        return str(error).removeprefix(f"{path}: ").rstrip(".")
    assert guess.time is None
    return (
        "no column of it is a time in a form that is known; name it t, in seconds or as ISO 8601, "
        'or write columns = { t = "..." } and time_format in drive.toml'
    )
