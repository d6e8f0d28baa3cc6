"""What the screening tries: the catalogue's effects."""

from __future__ import annotations

from collections.abc import Sequence

from automap.effects import CATALOGUE
from automap.gap.columns import Column, NodeMotion, effect_columns
from automap.gap.fit import Fit, Motion
from automap.gap.model import prior_sd

NEVER = (
    "accel_bias",
    "gyro_bias",
    "gnss_correlated_noise",
    "gnss_noise_scale",
    "gnss_outliers",
    "vehicle_pitch",
)
"""Part of every model, or of its noise."""
FAMILIES = ("imu", "vehicle", "clock", "gnss", "earth")
SAME_STATE = (
    ("gnss_latency", "imu_time_offset"),
    ("gnss_velocity_latency", "gnss_velocity_lag"),
)
"""Once one of a pair is in the model, the other says nothing new to first order."""


def library(settled: frozenset[str], has_wheels: bool, earth_on: bool) -> list[str]:
    """Names of the effects that could be missing from a model."""
    taken = set(settled) | set(NEVER)
    for pair in SAME_STATE:
        if taken & set(pair):
            taken |= set(pair)
    if not has_wheels:
        taken.add("odometer_scale")
    if earth_on:
        taken.add("earth_rotation")
    return [e for e in CATALOGUE if CATALOGUE[e].family in FAMILIES and e not in taken]


def library_columns(
    effects: Sequence[str], fit: Fit, motion: Motion, at: NodeMotion
) -> list[Column]:
    """Columns of all effects along one drive; an effect that the drive cannot show has none."""
    columns: list[Column] = []
    options = fit.model.options
    for effect in effects:
        sds = {p.name: prior_sd(options, effect, p.name) for p in CATALOGUE[effect].parameters}
        columns += effect_columns(effect, fit, motion, at, sds or {"on": 1.0})
    return columns
