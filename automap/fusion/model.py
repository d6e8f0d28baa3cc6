"""The filter's model of a drive: which effects are states, their priors and noise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from automap.effects import CATALOGUE, Effect, ImuTerm, effect_named, imu_terms
from automap.effects.measured import MEASURED, measured_terms
from automap.effects.term_sums import MeasuredTerms
from automap.effects.terms import INERTIAL, POSITION_ACCURACY
from automap.errors import ConfigError
from automap.fusion.layout import N_NAV
from automap.fusion.options import FusionOptions
from automap.records import FloatArray, IntArray


@dataclass(frozen=True)
class StateModel:
    """The error state of one run: terms, priors, process noise.

    ``terms`` on inertial readings in order, ``term_table`` [m, 4] their codes, ``measured`` the
    terms on fixes and vehicle and ``signals`` what they are multiplied with, ``places`` the first
    row of each such effect; ``names`` of the states after the nine navigation errors,
    ``prior_mean`` and ``prior_sd`` [n - 9], ``tau`` [n] s, 0 where a state only walks, ``walk`` [n]
    its variance, or the walk's growth of it in a second. ``kept`` [n]: which of a node's six
    shares outlasts a change of the fixes' size, -1 where the state does not go by it.
    """

    terms: tuple[ImuTerm, ...]
    term_table: IntArray
    measured: MeasuredTerms
    signals: tuple[str, ...]
    places: Mapping[str, int]
    names: tuple[str, ...]
    prior_mean: FloatArray
    prior_sd: FloatArray
    tau: FloatArray
    walk: FloatArray
    kept: IntArray

    @property
    def size(self) -> int:
        return N_NAV + len(self.names)

    def index(self, name: str) -> int:
        """Row of a named parameter in the error state."""
        return N_NAV + self.names.index(name)

    def rows(self, effect: str) -> slice:
        """Rows in the error state of an effect on measurements; empty where it is not estimated."""
        first = self.places.get(effect)
        if first is None:
            return slice(0, 0)
        return slice(first, first + len(CATALOGUE[effect].states))


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
    chosen = [*options.effects, *(e for e in options.fixed if e not in options.effects)]
    for effect in CATALOGUE.values():
        if effect.markov is None:
            continue
        if getattr(options, effect.markov.sd_setting) == 0.0:
            chosen = [name for name in chosen if name != effect.name]
        elif not effect.follows_accuracy and effect.name not in chosen:
            chosen.append(effect.name)
    imu_names = [e for e in chosen if effect_named(e).acts_on(*INERTIAL)]
    terms = tuple(imu_terms(imu_names))
    parameters = {t.name: t for t in terms}
    names = list(parameters)
    sd = [
        _prior(options, t.effect, t.parameter.name, t.parameter.prior_sd)
        for t in parameters.values()
    ]
    places: dict[str, int] = {}
    for name in chosen:
        if name not in imu_names:
            places[name] = N_NAV + len(names)
            for state, spread in _states(options, _estimable(name)):
                names.append(state)
                sd.append(spread)
    means = {**(means or {}), **given}
    sds = {**(sds or {}), **dict.fromkeys(given, 0.0)}
    n = N_NAV + len(names)
    tau, walk = np.zeros(n), np.zeros(n)
    kept = np.full(n, -1, dtype=np.int64)
    for i, term in enumerate(parameters.values()):
        setting = CATALOGUE[term.effect].walk_setting
        if setting and term.effect not in options.fixed:
            walk[N_NAV + i] = getattr(options, setting) ** 2
    for name, first in places.items():
        markov = CATALOGUE[name].markov
        if markov is None:
            continue
        rows = slice(first, first + len(CATALOGUE[name].states))
        tau[rows] = getattr(options, markov.tau_setting)
        walk[rows] = np.square(sd[first - N_NAV : rows.stop - N_NAV])
        if CATALOGUE[name].follows_accuracy:
            # normalised by the accuracy that fixes state, which changes along a drive
            shown = (effect_named(name).terms_of(state)[0] for state in effect_named(name).states)
            kept[rows] = [POSITION_ACCURACY.index(term.signal) for term in shown]
    mean = np.array([means.get(name, 0.0) for name in names])
    spreads = np.array([sds.get(name, s) for name, s in zip(names, sd, strict=True)])
    codes = [(t.sensor, t.axis, t.basis, names.index(t.name)) for t in terms]
    table = np.array(codes, dtype=np.int64).reshape(-1, 4)
    measured, signals = measured_terms({e: first - N_NAV for e, first in places.items()})
    return StateModel(
        terms, table, measured, signals, places, tuple(names), mean, spreads, tau, walk, kept
    )


def _states(options: FusionOptions, effect: Effect) -> Iterator[tuple[str, float]]:
    """Names and prior sds of what the filter estimates of an effect."""
    if effect.markov is not None:
        size = float(getattr(options, effect.markov.sd_setting))
        yield from ((f"{effect.name}_{state}", size) for state in effect.states)
        return
    for p in effect.parameters:
        yield f"{effect.name}_{p.name}", _prior(options, effect.name, p.name, p.prior_sd)


def _prior(options: FusionOptions, effect: str, parameter: str, default: float) -> float:
    given = options.prior_sd.get(effect, {})
    return float(given.get(parameter, given.get("*", default)))


def _estimable(name: str) -> Effect:
    """An effect on measurements; raises ConfigError where the filter has no states for it."""
    effect = CATALOGUE[name]
    if effect.acts_on(*MEASURED):
        return effect
    if effect.setting:
        raise ConfigError(f"fuse.effects: '{name}' is no state; it is set by {effect.setting}")
    states = [e.name for e in CATALOGUE.values() if e.family == "imu" or e.acts_on(*MEASURED)]
    raise ConfigError(
        f"fuse.effects: '{name}' cannot be estimated by the filter; choose from "
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
