"""Do the innovations look as the filter says they should: size one, and white.

NIS and whiteness tests: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking
and Navigation, section 5.4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from automap.fusion.doubts.limits import SMALL_SIGMAS, STRAIGHT_RAD
from automap.fusion.doubts.reason import Reason
from automap.fusion.limits import DOUBT_PROBABILITY, LEAST_JUDGED
from automap.gates import OUTSIDE_95, sigmas
from automap.records import Trajectory

if TYPE_CHECKING:
    from automap.fusion.output import Innovations

_AXES = {"n": "north", "e": "east", "d": "down"}
_PSEUDO = ("nhc", "zupt", "zaru")


@dataclass(frozen=True)
class ChannelConsistency:
    """One channel: count, rms of innovation over sd (1 is right), correlation of neighbours
    (0 is right), share that was not trusted less."""

    count: int
    normalised_rms: float
    lag1: float
    accepted_share: float

    @property
    def sigma_factor(self) -> float:
        """By how much sigmas that rest on this channel alone are too small.

        Of the correlation counts what chance does not make.
        """
        chance = sigmas(DOUBT_PROBABILITY) / math.sqrt(max(self.count, 1))
        return max(self.normalised_rms, 1.0) * _summed(self.lag1 - chance)

    @property
    def lasting(self) -> float:
        """Sums of innovations over what they would be if white and as large as assumed: of a
        channel that is kept loose, too."""
        return self.normalised_rms * _summed(self.lag1)

    @property
    def lasting_sd(self) -> float:
        """By what part of it chance moves ``lasting``: the innovations are worth as many
        independent ones as their sums say."""
        return _summed(self.lag1) / math.sqrt(2.0 * max(self.count, 1))


def _summed(correlation: float) -> float:
    """By how much sums of errors are larger than of independent ones.

    Errors that resemble their neighbours by r are worth (1 - r) / (1 + r) of as many
    independent ones (Bayley and Hammersley, J. Royal Statistical Society B 8, 1946).
    """
    alike = min(max(correlation, 0.0), 0.99)
    return math.sqrt((1.0 + alike) / (1.0 - alike))


def channel_consistency(table: Innovations) -> dict[str, ChannelConsistency]:
    """Consistency of every channel in the table."""
    out = {}
    for name in sorted(set(table.channel)):
        rows = table.channel == name
        ratio = table.innovation[rows] / table.sd[rows]
        lag1 = 0.0
        if len(ratio) >= LEAST_JUDGED and float(ratio.std()) > 0.0:
            lag1 = float(np.mean(ratio[1:] * ratio[:-1]) / np.mean(ratio**2))
        out[str(name)] = ChannelConsistency(
            len(ratio),
            float(np.sqrt(np.mean(ratio**2))),
            lag1,
            float(table.accepted[rows].mean()),
        )
    return out


def innovation_doubts(channels: dict[str, ChannelConsistency]) -> list[Reason]:
    """Measured channels by which the filter's sigmas are far too small (pseudo-measurements are
    kept loose and say nothing)."""
    found = {
        name: channel
        for name, channel in channels.items()
        if not name.startswith(_PSEUDO)
        and channel.count >= LEAST_JUDGED
        and channel.sigma_factor > SMALL_SIGMAS
    }
    if not found:
        return []
    factor = max(channel.sigma_factor for channel in found.values())
    sizes = {name: channel.normalised_rms for name, channel in found.items()}
    alike = {name: channel.lag1 for name, channel in found.items()}
    return [
        Reason(
            "innovations",
            f"innovations of {_names(found)} are {_span(sizes)} times as large as the filter "
            f"assumes, and neighbouring ones resemble each other (correlation {_span(alike)}): "
            f"something slow is not in its model, and its sigmas are {factor:.1f} times too small; "
            "try --tune, or 'automap gap'",
            factor=factor,
        )
    ]


def on_straights(table: Innovations, path: Trajectory, late_s: float) -> Innovations:
    """The innovations of nodes before which the ``path`` did not turn for long: courses that come
    ``late_s`` late turn the filter's nose in bends, and are followed by it all but e^-5."""
    t, yaw = path.t_ns * 1e-9, np.unwrap(path.rpy[:, 2])
    node = table.t_ns * 1e-9
    turned = np.interp(node, t, yaw) - np.interp(node - 5.0 * late_s, t, yaw)
    keep = np.abs(turned) < STRAIGHT_RAD
    return replace(table, **{item.name: getattr(table, item.name)[keep] for item in fields(table)})


def slides(channels: dict[str, ChannelConsistency]) -> list[Reason]:
    """The reason that a vehicle gives which goes sideways for long, as a boat does.

    The constraint is kept loose for quick slips; what lasts is judged by the limit of the measured
    channels and what chance adds to it. Sums are 0.2 to 1.3 of what is assumed in recorded cars,
    1.9 in one with a telephone's receiver (2.3 where its log was changed in ways that do no harm),
    1.8 at most in a thousand simulated drives, 3.9 and 8.2 in two boats that drift by 0.95 and
    0.65 m/s, and 1.6 in one that drifts by 0.53 m/s, which is missed.
    """
    side = channels.get("nhc_y")
    if side is None or side.count < LEAST_JUDGED:
        return []
    if side.lasting <= SMALL_SIGMAS * (1.0 + sigmas(OUTSIDE_95) * side.lasting_sd):
        return []
    return [
        Reason(
            "vehicle_slides",
            f"the vehicle goes sideways for long, {side.lasting:.1f} times as much as one on "
            "wheels, and heading and path, which rest on its nose, are off: for one that drifts, "
            "as a boat, set fuse.nhc_min_speed above its speed; else fasten the IMU, and check "
            "its axes",
            factor=side.lasting,
        )
    ]


def _names(found: dict[str, ChannelConsistency]) -> str:
    """Channels in words, the axes of one kind together: "position north, east"."""
    kinds: dict[str, list[str]] = {}
    for name in found:
        kind, _, axis = name.partition("_")
        kinds.setdefault(kind, []).append(_AXES.get(axis, axis))
    words = [
        kind if len(axes) == len(_AXES) or axes == [""] else f"{kind} {', '.join(axes)}"
        for kind, axes in kinds.items()
    ]
    return " and ".join(words)


def _span(found: dict[str, float]) -> str:
    low, high = f"{min(found.values()):.2f}", f"{max(found.values()):.2f}"
    return low if low == high else f"{low} to {high}"
