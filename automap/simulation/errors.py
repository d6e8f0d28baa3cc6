"""The errors that a scenario gives its sensors and its vehicle: effects by name."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping

from automap.effects import Effect, Parameter, effect_named
from automap.effects.entries.installation import EARTH
from automap.errors import ConfigError

Errors = Mapping[str, Mapping[str, float] | bool]


def check_errors(
    errors: Errors, has_gnss: bool = True, has_odometer: bool = True, has_boxes: bool = False
) -> None:
    """Refuse what cannot be simulated.

    Raises:
        ConfigError: an effect or a parameter that does not exist (the nearest is named), one of
            a sensor that the scenario does not have, or an impossible value. A camera has effects
            where its boxes are written in place of a video (``has_boxes``).
    """
    for name, values in errors.items():
        effect = effect_named(name)
        if name == EARTH:
            if not isinstance(values, bool):
                raise ConfigError(f"errors.{EARTH} is on or off; give true or false")
            continue
        if effect.family == "camera" and not has_boxes:
            raise ConfigError(
                f"effect '{name}' needs boxes in place of a video; give box_sd_px under [camera], "
                "or describe the camera that takes the video there"
            )
        known = {p.name: p for p in effect.parameters}
        if isinstance(values, bool):
            raise ConfigError(
                f"errors.{name} needs values, for instance "
                f"{name} = {{ {next(iter(known))} = 0.01 }}"
            )
        for parameter, value in values.items():
            if parameter not in known:
                near = difflib.get_close_matches(parameter, known, n=1)
                hint = f"; did you mean '{near[0]}'?" if near else ""
                raise ConfigError(
                    f"effect '{name}' has no parameter '{parameter}'; it has "
                    f"{', '.join(known)}{hint}"
                )
            _check_value(effect, known[parameter], value)
        lacking = [p for p in known if _is_time(effect, known[p]) and p not in values]
        if lacking and values and not effect.terms:
            raise ConfigError(f"errors.{name} lacks {lacking[0]}; give it, in s")
        if effect.family == "gnss" and not has_gnss:
            raise ConfigError(f"effect '{name}' needs a receiver; add a [gnss] section")
        if effect.needs_wheels and not has_odometer:
            raise ConfigError(f"effect '{name}' needs wheels that count; add an [odometer] section")


def _check_value(effect: Effect, parameter: Parameter, value: float) -> None:
    place = f"errors.{effect.name}.{parameter.name}"
    if not math.isfinite(value):
        raise ConfigError(f"{place} is {value}; give a number")
    if value < parameter.at_least:
        raise ConfigError(f"{place} is {value}; it cannot be negative")
    if value > parameter.at_most:
        raise ConfigError(f"{place} is {value}; a fraction lies between 0 and 1")
    if _is_time(effect, parameter) and value == 0.0:
        raise ConfigError(f"{place} is 0; give a time above 0 s")


def _is_time(effect: Effect, parameter: Parameter) -> bool:
    """Whether it is a time that an error lasts, which no term takes."""
    own = effect.family == "gnss" and not effect.terms_of(parameter.name)
    return own and parameter.unit == "s"


def error_values(errors: Errors) -> dict[str, dict[str, float]]:
    """The errors that are numbers, without the switches."""
    return {n: dict(v) for n, v in errors.items() if not isinstance(v, bool)}


def earth_rotates(errors: Errors) -> bool:
    """Whether the simulated Earth turns; it does unless ``earth_rotation = false``."""
    return bool(errors.get(EARTH, True))
