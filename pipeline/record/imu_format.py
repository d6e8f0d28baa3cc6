"""What the lines or frames of a serial inertial sensor look like, described in TOML."""

from __future__ import annotations

import difflib
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from automap.errors import ConfigError
from automap.io.axes import axes_matrix
from automap.io.sensor_file import find_sensor, read_preset, refuse_unknown
from pipeline.record.checksums import CHECKSUMS
from pipeline.shared.configs import configs_dir

SCHEMA = "automap.imu-line/1"
_FOLDER = "imu_lines"
READINGS = ("gx", "gy", "gz", "ax", "ay", "az")
_TIME = "time"
_COLUMNS = (*READINGS, "temp_c", _TIME, "-")
_KEYS = frozenset(
    {"schema", "name", "about", "sensor", "axes", "gyro_unit", "accel_unit", "baud", "rate_hz"}
    | {"text", "binary", "time", "scale"}
)
_TEXT_KEYS = frozenset({"separator", "prefix", "columns", "checksum"})
_BINARY_KEYS = frozenset({"sync", "struct", "fields", "checksum", "checksum_from"})
_TIME_KEYS = frozenset({"ns_per_count", "wraps_at"})


@dataclass(frozen=True)
class ImuFormat:
    """One kind of line or frame.

    ``columns`` names what stands where: gx .. az, temp_c, time (the device's own), - for
    what is of no use. Text: ``separator`` (blank: any white space), ``prefix`` that begins
    every line. Binary: ``layout`` of the whole frame without ``sync`` in front and checksum
    behind. ``scale`` multiplies columns; ``ns_per_count`` and ``wraps_at`` (0: never) are of
    the device's clock. ``baud`` are usual line rates.
    """

    name: str
    columns: tuple[str, ...]
    text: bool
    gyro_unit: str = "rad/s"
    accel_unit: str = "m/s^2"
    axes: str = "FRD"
    sensor: str | None = None
    baud: tuple[int, ...] = ()
    rate_hz: float | None = None
    separator: str = ","
    prefix: str = ""
    sync: bytes = b""
    layout: struct.Struct | None = None
    checksum: str | None = None
    checksum_from: int = 0
    scale: tuple[tuple[str, float], ...] = ()
    ns_per_count: float = 1.0
    wraps_at: int = 0

    @property
    def has_clock(self) -> bool:
        """Whether the device sends a time of its own."""
        return _TIME in self.columns

    @property
    def has_temperature(self) -> bool:
        """Whether it sends its temperature."""
        return "temp_c" in self.columns

    @property
    def frame_bytes(self) -> int:
        """Length of a binary frame with sync and checksum."""
        assert self.layout is not None
        extra = CHECKSUMS[self.checksum][0] if self.checksum else 0
        return len(self.sync) + self.layout.size + extra


def known_formats() -> list[str]:
    """Names of the formats that come along."""
    return sorted(path.stem for path in (configs_dir() / _FOLDER).glob("*.toml"))


def load_format(name: str) -> ImuFormat:
    """A format by name, or by the path of a file of one's own.

    Raises ConfigError, naming the nearest known format or the key that is wrong.
    """
    path = Path(name)
    if path.suffix != ".toml":
        known = known_formats()
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1, cutoff=0.4)
            advice = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}."
            raise ConfigError(f"there is no IMU line format {name!r}; {advice}")
        path = configs_dir() / _FOLDER / f"{name}.toml"
    return read_format(path)


def read_format(path: Path) -> ImuFormat:
    """Read the description of a format; ConfigError with the file and the key."""
    data = read_preset(path, SCHEMA)
    refuse_unknown(path, data, _KEYS, "")
    parts = [key for key in ("text", "binary") if key in data]
    if len(parts) != 1:
        raise ConfigError(f"{path}: one of the sections [text] and [binary] is needed.")
    _known_units(path, data)
    common: dict[str, Any] = {
        "name": str(data.get("name", path.stem)),
        "gyro_unit": data.get("gyro_unit", "rad/s"),
        "accel_unit": data.get("accel_unit", "m/s^2"),
        "axes": data.get("axes", "FRD"),
        "sensor": data.get("sensor"),
        "baud": _rates(path, data.get("baud", [])),
        "rate_hz": data.get("rate_hz"),
    }
    part = data[parts[0]]
    if not isinstance(part, dict):
        raise ConfigError(f"{path}: {parts[0]} is a section; write it as [{parts[0]}].")
    common |= _text(path, part) if parts[0] == "text" else _binary(path, part)
    columns = common["columns"]
    common |= _clock(path, data.get("time", {}), columns)
    scale = data.get("scale", {})
    for key, value in scale.items():
        good = isinstance(value, int | float) and not isinstance(value, bool)
        if key not in columns or not good:
            raise ConfigError(f"{path}: scale.{key} must be the factor of one of the columns.")
    return ImuFormat(**common, scale=tuple((k, float(v)) for k, v in scale.items()))


def _known_units(path: Path, data: dict[str, Any]) -> None:
    for key, units in (("gyro_unit", ("rad/s", "deg/s", "counts")),
                       ("accel_unit", ("m/s^2", "g", "counts"))):  # fmt: skip
        if data.get(key, units[0]) not in units:
            raise ConfigError(f"{path}: {key} must be one of {', '.join(units)}.")
    if "counts" in (data.get("gyro_unit"), data.get("accel_unit")):
        if not isinstance(data.get("sensor"), str):
            raise ConfigError(f"{path}: readings in counts need a sensor of configs/sensors/.")
        find_sensor(data["sensor"], path.parent)
    try:
        axes_matrix(data.get("axes", "FRD"))
    except ConfigError as error:
        raise ConfigError(f"{path}: axes: {error}") from None
    rate = data.get("rate_hz", 1.0)
    if not isinstance(rate, int | float) or not 0 < rate <= 20_000:
        raise ConfigError(f"{path}: rate_hz must be a number of samples a second.")


def _rates(path: Path, value: Any) -> tuple[int, ...]:
    rates = value if isinstance(value, list) else [value]
    if not all(isinstance(rate, int) and rate > 0 for rate in rates):
        raise ConfigError(f"{path}: baud must be a line rate or a list of them.")
    return tuple(rates)


def _columns(path: Path, key: str, value: Any) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise ConfigError(f"{path}: {key} must be a list of names such as {list(READINGS)}.")
    for name in value:
        if name not in _COLUMNS:
            near = difflib.get_close_matches(name, _COLUMNS, n=1, cutoff=0.4)
            advice = f"did you mean {near[0]}?" if near else f"known are {', '.join(_COLUMNS)}."
            raise ConfigError(f"{path}: {key} names a column {name!r}; {advice}")
        if name != "-" and value.count(name) > 1:
            raise ConfigError(f"{path}: {key} names {name} twice; call one of them -.")
    missing = [name for name in READINGS if name not in value]
    if missing:
        raise ConfigError(f"{path}: {key} lacks {', '.join(missing)}.")
    return tuple(value)


def _text(path: Path, part: dict[str, Any]) -> dict[str, Any]:
    refuse_unknown(path, part, _TEXT_KEYS, "text.")
    checksum = part.get("checksum", "none")
    if checksum not in ("none", "nmea"):
        raise ConfigError(f'{path}: text.checksum must be "none" or "nmea" (two digits after *).')
    separator, prefix = part.get("separator", ","), part.get("prefix", "")
    if not isinstance(separator, str) or not isinstance(prefix, str) or not separator:
        raise ConfigError(f"{path}: text.separator and text.prefix must be text.")
    return {
        "text": True,
        "columns": _columns(path, "text.columns", part.get("columns")),
        "separator": separator,
        "prefix": prefix,
        "checksum": None if checksum == "none" else checksum,
    }


def _binary(path: Path, part: dict[str, Any]) -> dict[str, Any]:
    refuse_unknown(path, part, _BINARY_KEYS, "binary.")
    columns = _columns(path, "binary.fields", part.get("fields"))
    form = str(part.get("struct", ""))
    try:
        sync = bytes.fromhex(str(part.get("sync", "")))
    except ValueError:
        raise ConfigError(f'{path}: binary.sync must be bytes such as "AA 55".') from None
    if not sync:
        raise ConfigError(f'{path}: binary.sync is missing; give the first bytes, as "AA 55".')
    if form[:1] not in ("<", ">"):
        raise ConfigError(
            f"{path}: binary.struct must begin with < or > (the order of bytes), as in <I6hh."
        )
    try:
        layout = struct.Struct(form)
        values = layout.unpack(bytes(layout.size))
    except struct.error as error:
        raise ConfigError(f"{path}: binary.struct {form!r}: {error}.") from None
    if len(values) != len(columns) or not all(isinstance(v, int | float) for v in values):
        raise ConfigError(
            f"{path}: binary.struct {form!r} has {len(values)} values and binary.fields names "
            f"{len(columns)}; each number needs one name."
        )
    checksum = part.get("checksum", "none")
    if checksum != "none" and checksum not in CHECKSUMS:
        raise ConfigError(f"{path}: binary.checksum must be none or one of {', '.join(CHECKSUMS)}.")
    begin = part.get("checksum_from", len(sync))
    if not isinstance(begin, int) or not 0 <= begin <= len(sync) + layout.size:
        raise ConfigError(f"{path}: binary.checksum_from must be a place within the frame.")
    return {
        "text": False,
        "columns": columns,
        "sync": sync,
        "layout": layout,
        "checksum": None if checksum == "none" else checksum,
        "checksum_from": begin,
    }


def _clock(path: Path, part: Any, columns: tuple[str, ...]) -> dict[str, Any]:
    if not isinstance(part, dict):
        raise ConfigError(f"{path}: time is a section; write it as [time].")
    refuse_unknown(path, part, _TIME_KEYS, "time.")
    if (_TIME in columns) != bool(part):
        raise ConfigError(
            f"{path}: a column time and a section [time] with ns_per_count belong together."
        )
    if not part:
        return {}
    per_count, wraps = part.get("ns_per_count"), part.get("wraps_at", 0)
    if not isinstance(per_count, int | float) or isinstance(per_count, bool) or per_count <= 0:
        raise ConfigError(f"{path}: time.ns_per_count must be the nanoseconds of one count.")
    if not isinstance(wraps, int) or wraps < 0:
        raise ConfigError(f"{path}: time.wraps_at must be the count at which it starts at 0.")
    return {"ns_per_count": per_count, "wraps_at": wraps}
