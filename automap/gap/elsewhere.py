"""What makes the same of all data in another channel than the one that is told.

A path that is stretched, turned or held otherwise in the vehicle leaves what is measured as it is,
if each channel errs by what the change does to it. So an error of one channel is the opposite error
of all others together: data show the difference between them, never which of them errs. Where both
are candidates, rivals say so; here stands what none is.
"""

from __future__ import annotations

from collections.abc import Sequence

from automap.effects.user import OF_ANTENNA, OF_MOUNT

STRETCHED = "positions that are stretched by as much the other way, as by the scale of a map"
TURNED = "positions that are turned by as much the other way, as those on the grid of a map are"
MOUNT = "a unit that turns in its mount by as much"
BODY = "a vehicle, the unit with it, that turns by as much against its way"
SLIDING = "a unit that slides by as much the other way"
OF_EFFECT = {"gnss_velocity_scale": STRETCHED, "vehicle_sideslip": MOUNT}
SPEED = "speed"


def elsewhere(effect: str, terms: Sequence[tuple[str, str]] = ()) -> str:
    """What would make the same of all data as an effect of the catalogue, or as a formula of one of
    the ``terms``, channel and text; nothing where that is known of none."""
    told = [OF_EFFECT[effect]] if effect in OF_EFFECT else [_of_term(*term) for term in terms]
    return told[0] if len(set(told)) == 1 else ""


def _of_term(channel: str, text: str) -> str:
    if channel in OF_MOUNT:
        return BODY
    if channel in OF_ANTENNA:
        return SLIDING
    if channel == "velocity_across" and text == SPEED:
        return TURNED
    # the constraint is of a velocity: an angle times the speed
    slips = channel in ("nhc_y", "nhc_z") and SPEED in text.split(" * ")
    return MOUNT if slips else ""
