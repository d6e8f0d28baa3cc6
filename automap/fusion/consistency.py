"""Do the innovations look as the filter says they should: size one, and white.

NIS and whiteness tests: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking
and Navigation, section 5.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from automap.fusion.limits import LEAST_JUDGED, PLAUSIBLE_CORRELATION, PLAUSIBLE_RMS

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


def verdict(channels: dict[str, ChannelConsistency]) -> str:
    """What the measured channels say of the filter, in words (pseudo-measurements are kept loose
    and say nothing)."""
    judged = {
        name: channel
        for name, channel in channels.items()
        if not name.startswith(_PSEUDO) and channel.count >= LEAST_JUDGED
    }
    if not judged:
        return "too few measurements to judge the filter by its innovations"
    ratios = {name: channel.normalised_rms for name, channel in judged.items()}
    large = {name: r for name, r in ratios.items() if r > PLAUSIBLE_RMS[1]}
    small = {name: r for name, r in ratios.items() if r < PLAUSIBLE_RMS[0]}
    coloured = {name: c.lag1 for name, c in judged.items() if abs(c.lag1) > PLAUSIBLE_CORRELATION}
    parts = []
    if large:
        parts.append(
            f"innovations of {_names(large)} scatter {_span(large)} times as much as the filter "
            "assumes: its sigmas are too small there"
        )
    if small:
        parts.append(
            f"innovations of {_names(small)} scatter only {_span(small)} times as much as the "
            "filter assumes: its sigmas are cautious there"
        )
    if coloured:
        parts.append(
            f"neighbouring innovations of {_names(coloured)} resemble each other (correlation "
            f"{_span(coloured)}): something slow is not in the model"
        )
    if parts:
        return "; ".join(parts)
    return (
        f"the innovations are about as large as the filter expects ({_span(ratios)} times their "
        "sigma) and as random"
    )


def _names(found: dict[str, float]) -> str:
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
