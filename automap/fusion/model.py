"""The filter's model of a drive: which effects are states, their priors and noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from automap.effects import CATALOGUE, ImuTerm, effect_named, imu_terms
from automap.effects.user_fixes import acts_on_fixes
from automap.errors import ConfigError
from automap.fusion.layout import (
    BLOCK_SIZE,
    DATUM,
    DELAY,
    LATENCY,
    LEVER,
    MOUNT,
    N_BLOCKS,
    N_NAV,
    ODOMETER_SCALE,
    SIDESLIP,
    SKEW,
    VEHICLE_PITCH,
    VEL_LAG,
    VEL_LATENCY,
    VEL_WANDER,
    WANDER,
    WHEEL,
)
from automap.fusion.options import FusionOptions
from automap.records import FloatArray, IntArray

_BLOCK_OF_EFFECT = {
    "gnss_lever_arm": LEVER,
    "imu_time_offset": DELAY,
    "gnss_velocity_latency": VEL_LATENCY,
    "gnss_correlated_noise": WANDER,
    "imu_mounting": MOUNT,
    "nhc_lever_arm": WHEEL,
    "gnss_latency": LATENCY,
    "gnss_velocity_lag": VEL_LAG,
    "imu_clock_skew": SKEW,
    "gnss_datum_shift": DATUM,
    "vehicle_sideslip": SIDESLIP,
    "odometer_scale": ODOMETER_SCALE,
    "vehicle_pitch": VEHICLE_PITCH,
}
_SETTINGS_OF_EFFECT = {
    "accel_bias_walk": "fuse.accel_bias_walk",
    "gyro_bias_walk": "fuse.gyro_bias_walk",
    "earth_rotation": "fuse.earth_rotation",
    "gnss_noise_scale": "fuse.adapt",
    "gnss_outliers": "fuse.gate_probability",
}
_WALK_OF_EFFECT = {"accel_bias": "accel_bias_walk", "gyro_bias": "gyro_bias_walk"}


@dataclass(frozen=True)
class StateModel:
    """The error state of one run: terms, offsets, priors, process noise.

    ``terms`` the inertial parameters in order, ``term_table`` [m, 3] their codes, ``offsets``
    [N_BLOCKS] of the measurement-side blocks (-1 off), ``names`` of the states after the nine
    navigation errors, ``prior_mean`` and ``prior_sd`` [n - 9], ``tau`` [n] s, 0
    where a state only walks, ``walk`` [n] its variance, or the walk's growth of it in a second.
    """

    terms: tuple[ImuTerm, ...]
    term_table: IntArray
    offsets: IntArray
    names: tuple[str, ...]
    prior_mean: FloatArray
    prior_sd: FloatArray
    tau: FloatArray
    walk: FloatArray

    @property
    def size(self) -> int:
        return N_NAV + len(self.names)

    def index(self, name: str) -> int:
        """Row of a named parameter in the error state."""
        return N_NAV + self.names.index(name)


def build_state_model(
    options: FusionOptions,
    means: Mapping[str, float] | None = None,
    sds: Mapping[str, float] | None = None,
) -> StateModel:
    """Lay out the error state of the options' effects.

    ``means`` and ``sds`` give prior means and one-sigma by full parameter name (for instance
    ``gyro_bias_x``), over the options' and the catalogue's.

    Raises:
        ConfigError: an effect that the filter has no states for.
    """
    given = _fixed_values(options)
    # what a user says of the fixes is taken out of them beforehand
    fixed = [e for e in options.fixed if not acts_on_fixes(e)]
    chosen = [*options.effects, *(e for e in fixed if e not in options.effects)]
    imu_names = [e for e in chosen if effect_named(e).family == "imu"]
    terms = tuple(imu_terms(imu_names))
    names = [t.name for t in terms]
    sd = [_prior(options, t.effect, t.parameter.name, t.parameter.prior_sd) for t in terms]
    offsets = np.full(N_BLOCKS, -1, dtype=np.int64)
    for effect in chosen:
        if effect in imu_names:
            continue
        block = _block_of(effect)
        offsets[block] = N_NAV + len(names)
        if block == WANDER:
            names += [f"{effect}_{a}" for a in "ned"]
            sd += [1.0, 1.0, 1.0]
            continue
        for parameter in CATALOGUE[effect].parameters[: BLOCK_SIZE[block]]:
            names.append(f"{effect}_{parameter.name}")
            sd.append(_prior(options, effect, parameter.name, parameter.prior_sd))
    if options.velocity_wander_sd > 0.0:
        offsets[VEL_WANDER] = N_NAV + len(names)
        names += [f"gnss_velocity_wander_{a}" for a in "ned"]
        sd += [options.velocity_wander_sd] * 3
    means = {**(means or {}), **given}
    sds = {**(sds or {}), **dict.fromkeys(given, 0.0)}
    n = N_NAV + len(names)
    tau = np.zeros(n)
    walk = np.zeros(n)
    for i, term in enumerate(terms):
        if term.effect in _WALK_OF_EFFECT and term.effect not in options.fixed:
            walk[N_NAV + i] = getattr(options, _WALK_OF_EFFECT[term.effect]) ** 2
    if offsets[WANDER] >= 0:
        block_rows = slice(int(offsets[WANDER]), int(offsets[WANDER]) + 3)
        tau[block_rows] = options.wander_tau_s
        walk[block_rows] = 1.0
    if offsets[VEL_WANDER] >= 0:
        block_rows = slice(int(offsets[VEL_WANDER]), int(offsets[VEL_WANDER]) + 3)
        tau[block_rows] = options.velocity_wander_tau_s
        walk[block_rows] = options.velocity_wander_sd**2
    mean = np.array([means.get(name, 0.0) for name in names])
    spread = np.array([sds.get(name, s) for name, s in zip(names, sd, strict=True)])
    table = np.array([(t.sensor, t.axis, t.basis) for t in terms], dtype=np.int64).reshape(-1, 3)
    return StateModel(terms, table, offsets, tuple(names), mean, spread, tau, walk)


def _prior(options: FusionOptions, effect: str, parameter: str, default: float) -> float:
    given = options.prior_sd.get(effect, {})
    return float(given.get(parameter, given.get("*", default)))


def _block_of(effect: str) -> int:
    """Block of a measurement-side effect; raises ConfigError where the filter has none."""
    if effect in _BLOCK_OF_EFFECT:
        return _BLOCK_OF_EFFECT[effect]
    if effect in _SETTINGS_OF_EFFECT:
        raise ConfigError(
            f"fuse.effects: '{effect}' is no state; it is set by {_SETTINGS_OF_EFFECT[effect]}"
        )
    if acts_on_fixes(effect):
        raise ConfigError(
            f"fuse.effects: '{effect}' acts on the fixes; automap gap finds its value, which a run "
            f"takes from fuse.fixed.{effect}"
        )
    states = [e for e in CATALOGUE if CATALOGUE[e].family == "imu"] + list(_BLOCK_OF_EFFECT)
    raise ConfigError(
        f"fuse.effects: '{effect}' cannot be estimated by the filter; choose from "
        + ", ".join(states)
    )


def _fixed_values(options: FusionOptions) -> dict[str, float]:
    """Values of fixed effects by full parameter name, zero where not named."""
    values: dict[str, float] = {}
    for effect, given in options.fixed.items():
        known = [p.name for p in effect_named(effect).parameters]
        for parameter in given:
            if parameter not in known:
                raise ConfigError(
                    f"fuse.fixed: '{effect}' has no parameter '{parameter}'; it has "
                    + ", ".join(known)
                )
        values |= {f"{effect}_{name}": float(given.get(name, 0.0)) for name in known}
    return values
