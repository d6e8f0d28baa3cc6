"""Sensor files: what one count of an inertial sensor is worth and how well it measures."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from automap.earth import STANDARD_GRAVITY
from automap.errors import ConfigError
from automap.io.table_units import UNITS
from automap.io.toml_file import read_toml
from automap.io.trust import check_inside
from automap.records import FloatArray

SCHEMA = "automap.sensor/1"
SI_PER_UNIT = UNITS["rate"] | UNITS["acceleration"]
"""The units in which an inertial log may be, but for counts."""
_TRIAD_KEYS = frozenset(
    {
        "bits",
        "adc_span_v",
        "sensitivity_v",
        "counts_per_unit",
        "zero_counts",
        "noise_density",
        "bias_walk",
        "bias_sd",
        "scale_sd",
        "misalignment_sd",
    }
)
_TOP_KEYS = frozenset({"schema", "name", "gyro", "accel"})


@dataclass(frozen=True)
class Triad:
    """Three axes: reading = (counts - zero) * scale.

    ``scale`` [3] rad/s or m/s^2 per count, ``zero`` [3] counts. What follows is NaN where the
    file does not give it: ``noise_density`` in rad/s/sqrt(Hz) or m/s^2/sqrt(Hz), ``bias_walk``
    the same per second, and one sigma over many sensors of ``bias`` in rad/s or m/s^2, of
    ``scale`` (relative) and of ``misalignment`` in rad.
    """

    scale: FloatArray
    zero: FloatArray
    noise_density: float
    bias_walk: float = float("nan")
    bias_sd: float = float("nan")
    scale_sd: float = float("nan")
    misalignment_sd: float = float("nan")

    def from_counts(self, counts: FloatArray) -> FloatArray:
        """Counts [n, 3] to SI units [n, 3]."""
        return np.asarray((counts - self.zero) * self.scale, dtype=np.float64)


@dataclass(frozen=True)
class SensorModel:
    """An inertial sensor as its data sheet describes it."""

    name: str
    gyro: Triad
    accel: Triad


def sensors_dir() -> Path | None:
    """The folder with the sensor files that come with AutoMap, in a checkout or installed."""
    root = Path(__file__).resolve().parents[2]
    for folder in (root / "pipeline" / "_configs" / "sensors", root / "configs" / "sensors"):
        if folder.is_dir():
            return folder
    return None


def find_sensor(name: str, drive: Path | None = None) -> Path:
    """The file of a sensor: ``NAME.toml`` in the drive folder, or among those that come along.

    Raises ConfigError naming the nearest known sensor.
    """
    return find_preset(name, drive, SCHEMA, "sensor")


def find_preset(name: str, drive: Path | None, schema: str, kind: str) -> Path:
    """As ``find_sensor``, for files of one schema; ``kind`` is what messages call them."""
    file_name = name if name.endswith(".toml") else f"{name}.toml"
    folders = [folder for folder in (drive, sensors_dir()) if folder is not None]
    for folder in folders:
        if (folder / file_name).is_file():
            check_inside(folder / file_name, folder, f"{folder}: a {kind} file")
            return folder / file_name
    known = preset_names(schema)
    near = difflib.get_close_matches(name.removesuffix(".toml"), known, n=1, cutoff=0.4)
    advice = f"did you mean {near[0]}?" if near else f"known are {', '.join(known) or 'none'}."
    raise ConfigError(
        f"there is no {kind} file {file_name} in configs/sensors/ or the drive; {advice}"
    )


def preset_names(schema: str) -> list[str]:
    """Names of the files of a schema that come along."""
    folder = sensors_dir()
    paths = sorted(folder.glob("*.toml")) if folder is not None else []
    return [path.stem for path in paths if f'"{schema}"' in path.read_text(encoding="utf-8")]


def read_sensor(path: Path) -> SensorModel:
    """Read a sensor file.

    For an analogue sensor behind a converter each triad gives ``bits`` (n_b), ``adc_span_v``
    (volts from the lowest to the highest count: V_ref for a single-ended converter, 2 V_ref
    for a bipolar one) and ``sensitivity_v`` per axis (volts per deg/s or per g); then

        scale = adc_span_v / (2^n_b * sensitivity_v)   per count.

    For a digital one it gives ``counts_per_unit`` (per deg/s or per g). ``zero_counts`` is
    the reading at zero input, 0 by default.

    Equation (2) of Amirsadri, Kim, Petersson and Trumpf, "Practical Considerations in Precise
    Calibration of a Low-cost MEMS IMU for Road-Mapping Applications", prints the gyro scale as
    2^(n_b - 1) V_ref / S_gyro, which is not degrees per second per count: the exponent lost
    its sign, and 2^-(n_b - 1) V_ref / S_gyro is the bipolar case of the formula above.

    Raises ConfigError with the file and the key.
    """
    data = read_preset(path, SCHEMA)
    refuse_unknown(path, data, _TOP_KEYS, "")
    return SensorModel(
        name=str(data.get("name", path.stem)),
        gyro=_triad(path, data, "gyro", np.pi / 180.0),
        accel=_triad(path, data, "accel", STANDARD_GRAVITY),
    )


def read_preset(path: Path, schema: str) -> dict[str, Any]:
    """The content of a file of a schema; raises ConfigError."""
    data = read_toml(path)
    if data.get("schema") != schema:
        raise ConfigError(f'{path}: the line schema = "{schema}" is missing; add it.')
    return data


def refuse_unknown(path: Path, table: dict[str, Any], known: frozenset[str], prefix: str) -> None:
    """Raise ConfigError for a key that does not exist, naming the nearest that does."""
    for key in table:
        if key not in known:
            near = difflib.get_close_matches(key, sorted(known), n=1, cutoff=0.4)
            advice = (
                f"did you mean {near[0]}?" if near else f"known are {', '.join(sorted(known))}."
            )
            raise ConfigError(f"{path}: unknown key {prefix}{key}; {advice}")


_MOST = 1e30  # of no sensor, and its reciprocal of none either


def _triad(path: Path, data: dict[str, Any], name: str, unit: float) -> Triad:
    table = data.get(name)
    if not isinstance(table, dict):
        raise ConfigError(f"{path}: the section [{name}] is missing; add it.")
    refuse_unknown(path, table, _TRIAD_KEYS, f"{name}.")
    if "counts_per_unit" in table:
        scale = unit / _axes(path, table, f"{name}.counts_per_unit")
    else:
        bits = table.get("bits")
        if not isinstance(bits, int) or not 1 <= bits <= 32:
            raise ConfigError(
                f"{path}: [{name}] needs counts_per_unit, or bits (1 to 32), adc_span_v "
                "and sensitivity_v."
            )
        span = _axes(path, table, f"{name}.adc_span_v")
        scale = unit * span / (2.0**bits * _axes(path, table, f"{name}.sensitivity_v"))
    zero = np.zeros(3)
    if "zero_counts" in table:
        zero = _axes(path, table, f"{name}.zero_counts", nonzero=False)

    def figure(key: str, factor: float) -> float:
        return positive_number(path, table, name, key) * factor

    return Triad(
        scale=scale,
        zero=zero,
        noise_density=figure("noise_density", unit),
        bias_walk=figure("bias_walk", unit),
        bias_sd=figure("bias_sd", unit),
        scale_sd=figure("scale_sd", 1.0),
        misalignment_sd=figure("misalignment_sd", 1.0),
    )


def positive_number(path: Path, table: dict[str, Any], section: str, key: str) -> float:
    """A figure of a file's section, NaN where it is not given; ConfigError unless positive."""
    if key not in table:
        return float("nan")
    value = table[key]
    good = isinstance(value, int | float) and not isinstance(value, bool)
    if not good or not 0.0 < value < float("inf"):
        raise ConfigError(f"{path}: {section}.{key} must be a number above 0.")
    return float(value)


def _axes(path: Path, table: dict[str, Any], key: str, *, nonzero: bool = True) -> FloatArray:
    """A value for all axes or one for each, as [3]."""
    value = table.get(key.rsplit(".", 1)[1])
    try:
        axes = np.broadcast_to(np.asarray(value, dtype=np.float64), (3,)).copy()
    except (TypeError, ValueError):
        axes = np.full(3, np.nan)
    size = np.abs(axes)
    if not np.all(size < _MOST) or (nonzero and not np.all(size > 1.0 / _MOST)):
        what = "numbers other than zero" if nonzero else "numbers"
        raise ConfigError(f"{path}: {key} must be one or three {what}.")
    return axes
