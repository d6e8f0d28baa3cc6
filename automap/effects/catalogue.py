"""All effects: names, parameters, units, priors, and the terms by which they act."""

from __future__ import annotations

import difflib

from automap.effects.effect import Effect
from automap.effects.entries.camera import CAMERA
from automap.effects.entries.inertial import INERTIAL
from automap.effects.entries.installation import INSTALLATION
from automap.effects.entries.receiver import RECEIVER
from automap.effects.entries.vehicle import VEHICLE_AND_WHEELS
from automap.errors import ConfigError

CATALOGUE: dict[str, Effect] = {
    e.name: e for e in (*INERTIAL, *INSTALLATION, *RECEIVER, *VEHICLE_AND_WHEELS, *CAMERA)
}


def effect_named(name: str) -> Effect:
    """The effect of that name.

    Raises:
        ConfigError: no such effect; the message names the nearest one.
    """
    if name in CATALOGUE:
        return CATALOGUE[name]
    near = difflib.get_close_matches(name, CATALOGUE, n=1)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    raise ConfigError(f"there is no effect named '{name}'{hint}")


def alike_to_first_order() -> list[tuple[str, str]]:
    """Pairs of effects that a filter cannot tell apart to first order."""
    return [pair for sign in (-1.0, 1.0) for pair in pairs_of_sign(sign)]


def pairs_of_sign(sign: float) -> list[tuple[str, str]]:
    """Those pairs of them that act with opposite (-1) or the same sign (1)."""
    pairs = [
        (e.name, e.first_order[0])
        for e in CATALOGUE.values()
        if e.first_order and e.first_order[1] == sign
    ]
    return [(min(pair), max(pair)) for pair in pairs]


def bias_walks() -> dict[str, Effect]:
    """The random walks of biases by name, and the bias that walks."""
    return {e.walk_setting: e for e in CATALOGUE.values() if e.walk_setting}
