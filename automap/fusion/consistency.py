"""Do the innovations look as the filter says they should: size one, and white.

NIS and whiteness tests: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking
and Navigation, section 5.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.fusion.output import Innovations

MIN_COUNT = 20
PLAUSIBLE_RMS = (0.7, 1.4)
PLAUSIBLE_CORRELATION = 0.35
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
        if len(ratio) >= MIN_COUNT and float(ratio.std()) > 0.0:
            lag1 = float(np.mean(ratio[1:] * ratio[:-1]) / np.mean(ratio**2))
        out[str(name)] = ChannelConsistency(
            len(ratio),
            float(np.sqrt(np.mean(ratio**2))),
            lag1,
            float(table.accepted[rows].mean()),
        )
    return out


def verdict(channels: dict[str, ChannelConsistency]) -> str:
    """One plain sentence on the measured channels (pseudo-measurements are kept loose)."""
    large, small, coloured = [], [], []
    judged = 0
    for name, channel in channels.items():
        if name.startswith(_PSEUDO) or channel.count < MIN_COUNT:
            continue
        judged += 1
        label = name.replace("_", " ")
        if channel.normalised_rms > PLAUSIBLE_RMS[1]:
            large.append(label)
        elif channel.normalised_rms < PLAUSIBLE_RMS[0]:
            small.append(label)
        if abs(channel.lag1) > PLAUSIBLE_CORRELATION:
            coloured.append(label)
    if judged == 0:
        return "too few measurements to judge the filter by its innovations"
    parts = []
    if large:
        parts.append("errors are larger than assumed in " + ", ".join(large))
    if small:
        parts.append("errors are smaller than assumed in " + ", ".join(small))
    if coloured:
        parts.append(
            "neighbouring innovations resemble each other in "
            + ", ".join(coloured)
            + ": something slow is not modelled"
        )
    if not parts:
        return "the innovations are as large and as random as the filter expects"
    return "; ".join(parts)
