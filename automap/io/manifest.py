"""The manifest ``drive.toml``: its sections, defaults and what can be wrong with it."""

from __future__ import annotations

import difflib
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    ValidationError,
    ValidationInfo,
    field_validator,
)

from automap.errors import ConfigError, InputError
from automap.io import limits, names
from automap.io.axes import axes_matrix, triad_matrix
from automap.io.table_form import (
    Separator,
    TableForm,
    TableKind,
    checked_columns,
    checked_time_format,
    checked_units,
)
from automap.io.table_units import Quantity, unit_named
from automap.io.toml_file import no_boolean, parse_toml
from automap.io.toml_place import keys_in_file, line_of
from automap.records import FARTHEST_ARM_M, LEVER_ARM_SD_M

SCHEMA = "automap.drive/1"
MINIMAL = 'schema = "automap.drive/1"'

TimeBase = Literal["boot_ns", "gps_ns", "unix_ns"]
Triple = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
Positive = Annotated[FiniteFloat, Field(gt=0)]
NotNegative = Annotated[FiniteFloat, Field(ge=0)]


class Section(BaseModel):
    """A table of the manifest; unknown keys are refused, and points that no vehicle has."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @field_validator("*", mode="before")
    @classmethod
    def _number_is_one(cls, value: Any, info: ValidationInfo) -> Any:
        return no_boolean(value, cls.model_fields[str(info.field_name)].annotation)

    @field_validator("*", mode="after")
    @classmethod
    def _size_is_possible(cls, value: Any, info: ValidationInfo) -> Any:
        arm = info.field_name == "lever_arm_m"
        most = FARTHEST_ARM_M if arm else limits.MAX_NUMBER
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, float) and abs(number) > most:
                raise ValueError(f"{number:g} is more than {most:g}; correct it or its unit")
        return value


class TableSection(Section):
    """What a section says of its table; all of it is guessed from the file where it is absent."""

    kind: ClassVar[TableKind]
    columns: dict[str, str | int] = {}
    separator: Separator | None = None
    decimal: Literal[".", ","] | None = None
    time_format: str | None = None
    units: dict[str, str] = {}
    utc_offset_h: Annotated[FiniteFloat, Field(ge=-24, le=24)] = 0.0

    @field_validator("columns", mode="after")
    @classmethod
    def _columns_exist(cls, value: dict[str, str | int]) -> dict[str, str | int]:
        return checked_columns(value, cls.kind)

    @field_validator("units", mode="after")
    @classmethod
    def _units_exist(cls, value: dict[str, str]) -> dict[str, str]:
        return checked_units(value, cls.kind)

    @field_validator("time_format", mode="after")
    @classmethod
    def _format_exists(cls, value: str | None) -> str | None:
        return None if value is None else checked_time_format(value)

    @property
    def form(self) -> TableForm:
        """How the section's table is to be read."""
        return TableForm(
            self.columns,
            self.separator,
            self.decimal,
            self.time_format,
            self.units,
            self.utc_offset_h,
        )


class ImuSection(TableSection):
    """``[imu]``. Without ``axes`` the sensor is taken to be mounted forward, right, down; a triad
    has axes of its own where ``accel_axes`` or ``gyro_axes`` say so. ``axes_sigma_deg``: how
    exactly the case sits as stated, by eye where nobody says; pitch and yaw the drive tells."""

    kind: ClassVar[TableKind] = "imu"
    file: str | None = None
    axes: str | list[list[FiniteFloat]] = "FRD"
    accel_axes: str | list[list[FiniteFloat]] | None = None
    gyro_axes: str | list[list[FiniteFloat]] | None = None
    axes_sigma_deg: NotNegative = 1.0
    time: TimeBase = "boot_ns"
    gyro_unit: Literal["rad/s", "deg/s", "mrad/s", "mdeg/s", "rpm", "counts"] = "rad/s"
    accel_unit: Literal["m/s^2", "g", "mg", "cm/s^2", "counts"] = "m/s^2"
    sensor: str | None = None
    calibration: str | None = None

    def stated(self, key: str) -> str | None:
        """A value that the manifest itself gives, None where it is a default."""
        return getattr(self, key) if key in self.model_fields_set else None

    @field_validator("gyro_unit", "accel_unit", mode="before")
    @classmethod
    def _unit_by_our_name(cls, value: Any, info: ValidationInfo) -> Any:
        quantity: Quantity = "rate" if info.field_name == "gyro_unit" else "acceleration"
        known = unit_named(value, quantity) if isinstance(value, str) else None
        return value if known is None else known

    @field_validator("axes", "accel_axes", "gyro_axes", mode="after")
    @classmethod
    def _axes_make_sense(cls, value: Any, info: ValidationInfo) -> Any:
        if value is None:
            return None
        try:
            (axes_matrix if info.field_name == "axes" else triad_matrix)(value)
        except ConfigError as error:
            raise ValueError(str(error)) from None
        return value


class ArrivalTable(TableSection):
    """``[gnss.arrival_table]``: how the file of arrival times is to be read."""

    kind: ClassVar[TableKind] = "arrival"


class GnssSection(TableSection):
    """``[gnss]``. No ``lever_arm_m``: not measured, the fusion estimates it. ``receiver`` names a
    file of ``configs/sensors/``. What is said of a table is for logs that are a table of fixes."""

    kind: ClassVar[TableKind] = "gnss"
    file: str | None = None
    receiver: str | None = None
    arrival: str | None = None
    arrival_time: TimeBase = "boot_ns"
    arrival_table: ArrivalTable = ArrivalTable()
    output_delay_s: Annotated[FiniteFloat, Field(ge=0, le=2)] | None = None
    lever_arm_m: Triple | None = None


class OdometerSection(TableSection):
    """``[odometer]``: wheel or CAN speed; no ``time``: stamped by the clock of the IMU."""

    kind: ClassVar[TableKind] = "odometer"
    file: str | None = None
    time: TimeBase | None = None


class VideoSection(Section):
    """``[video.NAME]``: one camera."""

    files: tuple[str, ...] | None = None
    frames: str | None = None
    time: TimeBase = "boot_ns"
    start_ns: int | None = None
    detections: str | None = None
    width: Annotated[int, Field(gt=0)] | None = None
    height: Annotated[int, Field(gt=0)] | None = None
    camera_matrix: tuple[Triple, Triple, Triple] | None = None
    distortion: tuple[FiniteFloat, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)
    distortion_sigma: NotNegative | None = None
    lever_arm_m: Triple = (0.0, 0.0, 0.0)
    lever_arm_sigma_m: NotNegative = LEVER_ARM_SD_M
    mount_rpy_deg: Triple = (0.0, 0.0, 0.0)
    mount_rpy_sigma_deg: NotNegative = 2.0
    time_offset_s: FiniteFloat = 0.0
    time_offset_sigma_s: NotNegative = 0.1

    @field_validator("camera_matrix", mode="after")
    @classmethod
    def _matrix_is_pinhole(cls, value: Any) -> Any:
        if value is None:
            return value
        (fx, _, _), (s, fy, _), bottom = value
        if fx <= 0 or fy <= 0 or s != 0 or tuple(bottom) != (0.0, 0.0, 1.0):
            raise ValueError(
                "must be [[fx, skew, cx], [0, fy, cy], [0, 0, 1]] in pixels with positive fx, fy"
            )
        return value

    @field_validator("distortion", mode="after")
    @classmethod
    def _length_is_of_opencv(cls, value: Any) -> Any:
        if len(value) not in (0, 4, 5, 8, 12, 14):
            raise ValueError("OpenCV's distortion has 4, 5, 8, 12 or 14 coefficients")
        return value


CAMERA_KEYS = frozenset(VideoSection.model_fields) - {
    *("files", "frames", "time", "start_ns", "detections")
}
"""What ``[video.NAME]`` says of the camera itself: optics, place, direction and offset."""


class SiteSection(Section):
    """``[site]``. ``country`` is the ISO 3166 code of two letters, ``roads`` a file of lines,
    ``background`` one of pictures, tiles or lines to lay below the map."""

    country: Annotated[str, Field(pattern="^[A-Za-z]{2}$")] | None = None
    traffic_side: Literal["left", "right"] | None = None
    roads: str | None = None
    background: str | None = None


class VehicleSection(Section):
    """``[vehicle]``: how high the IMU is above the road where the loaded vehicle stands."""

    imu_above_road_m: Annotated[FiniteFloat, Field(ge=0, le=10)] | None = None
    imu_above_road_sigma_m: Annotated[FiniteFloat, Field(ge=0, le=10)] = 0.03


class Manifest(Section):
    """The whole of ``drive.toml``; everything but ``schema`` has a default. ``accept`` names what
    is known to be wrong with the recording and no reason to stop."""

    schema_: Literal["automap.drive/1"] = Field(alias="schema")
    name: str | None = None
    accept: tuple[Annotated[str, Field(pattern="^[a-z][a-z0-9_]*$")], ...] = ()
    imu: ImuSection = ImuSection()
    gnss: GnssSection = GnssSection()
    odometer: OdometerSection = OdometerSection()
    video: dict[str, VideoSection] = {}
    site: SiteSection = SiteSection()
    vehicle: VehicleSection = VehicleSection()


def read_manifest(path: Path) -> Manifest:
    """Read and check ``drive.toml``.

    Raises InputError when there is none and ConfigError, with file and line, for text that
    is no TOML, a key that does not exist (naming the nearest that does) or a wrong value.
    """
    try:
        raw = path.read_bytes()
    except FileNotFoundError:
        folder = path.parent
        if (folder / names.RUN).is_file():
            raise InputError(
                f"{folder} holds results, no recordings; give the folder of the drive."
            ) from None
        raise InputError(
            f"{path} is missing: it makes a folder a drive. automap init makes it of recordings "
            f"that lie there; or write a file of that name with at least the line {MINIMAL}"
        ) from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}.") from error
    data = parse_toml(path, raw)
    if "schema" not in data:
        raise ConfigError(f"{path}: the first line is missing; add {MINIMAL}")
    if data["schema"] != SCHEMA:
        raise ConfigError(
            f"{path}: schema {data['schema']!r} is not known; this version reads {MINIMAL}"
        )
    try:
        return Manifest.model_validate(data)
    except ValidationError as error:
        text = raw.decode("utf-8")
        raise ConfigError(f"{path}: {_sentence(error, text)}") from None


def _sentence(error: ValidationError, text: str) -> str:
    first = error.errors()[0]
    location = [str(part) for part in first["loc"]]
    kind = first["type"]
    # a union adds the names of its branches to the location; keep what stands in the file
    keys = keys_in_file(location, text)
    line = line_of(keys, text)
    where = f"line {line}: " if line else ""
    name = ".".join(keys)
    if kind == "extra_forbidden":
        known = _known_keys(keys[:-1])
        near = difflib.get_close_matches(keys[-1], known, n=1, cutoff=0.5)
        advice = f"did you mean {near[0]}?" if near else f"known here: {', '.join(known)}."
        return f"{where}unknown key {name}; {advice}"
    message = first["msg"].removeprefix("Value error, ").rstrip(".")
    if kind == "literal_error":
        return f"{where}{name} is {first['input']!r}; it must be {first['ctx']['expected']}."
    if kind == "value_error":
        return f"{where}{name}: {message}."
    if kind in ("model_type", "dict_type"):
        return f"{where}{name} is a section; write it as [{name}] with its keys below."
    if kind in ("missing", "too_long") and first["loc"][-1:] != (keys[-1],):
        message = "three numbers are expected"
    elif kind in ("tuple_type", "too_long"):
        listed = {"files": '["front.mp4"]', "accept": '["imu_axes"]'}
        message = f"must be a list such as {listed.get(keys[-1], '[0.4, 0.1, -1.2]')}"
    elif kind == "string_pattern_mismatch" and keys[-1] == "country":
        message = 'must be two letters, such as "DE"'
    elif kind in _LIMITS:
        message = _beyond(keys[-1], kind, first)
    elif "columns" in keys:
        message = "must be the file's name of the column in quotes, or its number"
    elif keys[0] == "imu" and keys[-1].endswith("axes"):
        message = 'must be text such as "FRD" or a 3x3 matrix of numbers'
    message = message[:1].lower() + message[1:]
    return f"{where}{name}: {message}, but it is {_shown(first.get('input'))}."


_LIMITS = {
    "less_than_equal": ("at most", "le"),
    "less_than": ("less than", "lt"),
    "greater_than_equal": ("at least", "ge"),
    "greater_than": ("more than", "gt"),
}
"""How a limit of a number is said, and the name that pydantic has for it."""
_UNIT_OF = {"s": "s", "m": "m", "deg": "deg", "h": "h"}
"""The unit that the last word of a key tells."""


def _beyond(key: str, kind: str, error: Any) -> str:
    """What a number must be, with the unit that its key tells, and the number in that where it
    looks like thousandths."""
    words, limit = _LIMITS[kind]
    unit = _UNIT_OF.get(key.rpartition("_")[2], "")
    # a number in quotes is read as one
    bound, value = error["ctx"][limit], float(error["input"])
    message = f"must be {words} {bound:g} {unit}".rstrip()
    if unit in ("s", "m") and limit in ("le", "lt") and value * 1e-3 <= bound:
        message += f" ({value:g} m{unit} are {value * 1e-3:g} {unit})"
    return message


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _known_keys(parents: list[str]) -> list[str]:
    model: type[BaseModel] = Manifest
    for parent in parents:
        if model is Manifest and parent == "video":
            return _fields(VideoSection) if len(parents) > 1 else []
        annotation = model.model_fields[parent].annotation
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            model = annotation
    return _fields(model)


def _fields(model: type[BaseModel]) -> list[str]:
    return [info.alias or name for name, info in model.model_fields.items()]


TIME_BASES: tuple[str, ...] = get_args(TimeBase)
