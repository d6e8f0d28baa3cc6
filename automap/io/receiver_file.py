"""Receiver files: how a GPS receiver's errors behave, beyond the accuracy it states itself."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from automap.errors import ConfigError
from automap.io.sensor_file import find_preset, positive_number, read_preset, refuse_unknown

SCHEMA = "automap.receiver/1"
FIGURES = (
    "white_share",
    "wander_share",
    "wander_tau_s",
    "horizontal_sd_m",
    "vertical_sd_m",
    "velocity_sd",
    "min_position_sd_m",
    "min_velocity_sd",
)
"""Figures of the section ``[errors]`` that carry the names of the fusion's settings."""
LATENCY = "velocity_latency_sd_s"


@dataclass(frozen=True)
class ReceiverModel:
    """A receiver: ``figures`` by the names of the fusion's settings, only those that the file
    gives; ``velocity_latency_sd_s`` one sigma of velocities older than positions, or NaN."""

    name: str
    figures: dict[str, float]
    velocity_latency_sd_s: float


def find_receiver(name: str, drive: Path | None = None) -> Path:
    """The file of a receiver: ``NAME.toml`` in the drive folder, or among those that come along.

    Raises ConfigError naming the nearest known receiver.
    """
    return find_preset(name, drive, SCHEMA, "receiver")


def read_receiver(path: Path) -> ReceiverModel:
    """Read a receiver file; raises ConfigError with the file and the key."""
    data = read_preset(path, SCHEMA)
    refuse_unknown(path, data, frozenset({"schema", "name", "errors"}), "")
    table = data.get("errors")
    if not isinstance(table, dict):
        raise ConfigError(f"{path}: the section [errors] is missing; add it.")
    refuse_unknown(path, table, frozenset({*FIGURES, LATENCY}), "errors.")
    figures = {key: positive_number(path, table, "errors", key) for key in FIGURES if key in table}
    latency = positive_number(path, table, "errors", LATENCY)
    return ReceiverModel(str(data.get("name", path.stem)), figures, latency)
