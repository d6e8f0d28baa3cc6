"""Receivers that the simulator knows: ``configs/receivers``."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from automap.errors import ConfigError
from automap.io.sensor_file import read_preset, refuse_unknown
from pipeline.shared.configs import configs_dir

SCHEMA = "automap.simulated-receiver/1"
_OF_THE_CAR = ("lever_arm_m", "dropouts", "geoid_separation_m", "gnss_lever_arm")
"""What belongs to the drive and not to the receiver."""


def receiver_names() -> list[str]:
    """Names of the receivers that come along."""
    return sorted(path.stem for path in (configs_dir() / "receivers").glob("*.toml"))


def find_receiver(name: str, beside: Path | None = None) -> Path:
    """The file of a receiver: ``NAME.toml`` in the folder ``beside``, or one that comes along.

    Raises ConfigError naming the nearest known one.
    """
    file_name = name if name.endswith(".toml") else f"{name}.toml"
    for folder in (beside, configs_dir() / "receivers"):
        if folder is not None and (folder / file_name).is_file():
            return folder / file_name
    known = receiver_names()
    near = difflib.get_close_matches(name.removesuffix(".toml"), known, n=1)
    advice = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}."
    raise ConfigError(f"there is no receiver {name} in configs/receivers/; {advice}")


def with_receiver(
    scenario: Mapping[str, Any], beside: Path | None = None, instead: str = ""
) -> dict[str, Any]:
    """The content of a scenario file with the receiver that its section ``[gnss]`` names.

    What the scenario says itself stands before what the receiver's file says; a receiver given
    ``instead`` stands before the scenario, but for the dropouts and the antenna. Files lie
    ``beside`` the scenario or come along. Raises ConfigError.
    """
    own = scenario.get("gnss")
    if instead and own is None:
        raise ConfigError("the scenario has no receiver; add a [gnss] section")
    name = instead or (own.get("receiver", "") if isinstance(own, Mapping) else "")
    if not name or not isinstance(name, str) or not isinstance(own, Mapping):
        return dict(scenario)
    path = find_receiver(name, beside)
    preset = read_preset(path, SCHEMA)
    refuse_unknown(path, preset, frozenset({"schema", "name", "gnss", "errors"}), "")
    errors = scenario.get("errors", {})
    pairs = ((own, preset.get("gnss", {})), (errors, preset.get("errors", {})))
    if not all(isinstance(part, Mapping) for pair in pairs for part in pair):
        raise ConfigError(f"{path}: [gnss] and [errors] are sections; write them as such.")
    if instead:
        # its errors and no others: what the scenario says of its own receiver goes
        own = {key: own[key] for key in _OF_THE_CAR if key in own}
        errors = {k: v for k, v in errors.items() if k in _OF_THE_CAR or not k.startswith("gnss_")}
    return {
        **scenario,
        "gnss": {**preset.get("gnss", {}), **own, "receiver": name},
        "errors": {**preset.get("errors", {}), **errors},
    }
