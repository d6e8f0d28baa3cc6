"""The model whose gap is measured: nuisances, values carried over, noise levels."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

from automap.effects import CATALOGUE
from automap.fusion.levels import ALL_LEVELS
from automap.fusion.options import FusionOptions

Values = Mapping[str, Mapping[str, float]]

ALWAYS = ("gnss_course_distance", "vehicle_pitch")
"""What every receiver and every vehicle has, whatever else is asked: courses that lag at low speed,
and springs."""
BASE_NUISANCES = (
    "accel_bias",
    "gyro_bias",
    "gnss_correlated_noise",
    "gnss_multipath",
    *ALWAYS,
)
"""What the base model estimates on every drive anew: every receiver's positions err for minutes
and for seconds."""

SKEW = "imu_clock_skew"


@dataclass(frozen=True)
class GapModel:
    """``options`` with the nuisances as effects; ``values`` of the named effects, carried over
    from drive to drive; ``factors`` on the noise levels ``ALL_LEVELS``."""

    options: FusionOptions
    values: Values = field(default_factory=dict)
    factors: Mapping[str, float] = field(default_factory=lambda: dict.fromkeys(ALL_LEVELS, 1.0))

    @property
    def included(self) -> frozenset[str]:
        """Effects that the model has, as nuisance or with a value."""
        return frozenset(self.options.effects) | frozenset(self.values)


def base_model(options: FusionOptions | None = None) -> GapModel:
    """The model that is taken where nobody gives another: biases, their drift, a receiver whose
    error wanders, the vehicle constraint at the IMU, noise as ``options`` say."""
    options = usual_options(options or base_options(FusionOptions()))
    values = {e: dict(v) for e, v in options.fixed.items() if e != "gnss_lever_arm"}
    factors = dict.fromkeys(ALL_LEVELS, 1.0) | dict(options.factors)
    options = plain_options(options)
    return GapModel(options, values, factors)


def base_options(options: FusionOptions, stated: Collection[str] = ()) -> FusionOptions:
    """The options with the base model in place of an ordinary run's effects, but where they are
    ``stated``: an ordinary run estimates some that are findings here."""
    return options if "effects" in stated else replace(options, effects=BASE_NUISANCES)


def usual_options(options: FusionOptions) -> FusionOptions:
    """The options with what every vehicle and every receiver has among the nuisances: springs, and
    courses that lag at low speed."""
    more = [e for e in ALWAYS if e not in options.effects and e not in options.fixed]
    return replace(options, effects=(*options.effects, *more))


def without_course_distance(model: GapModel) -> GapModel:
    """A model in which no course lags with the distance."""
    effects = tuple(e for e in model.options.effects if e != "gnss_course_distance")
    return replace(model, options=replace(model.options, effects=effects))


def plain_options(options: FusionOptions) -> FusionOptions:
    """The options for passes whose noise is given, not adapted."""
    return replace(options, adapt=False, tune=False, fixed={}, retime=False)


def prior_sd(options: FusionOptions, effect: str, parameter: str) -> float:
    """One sigma of a parameter before the drive: the options', else the catalogue's."""
    given = options.prior_sd.get(effect, {})
    known = {p.name: p.prior_sd for p in CATALOGUE[effect].parameters}
    return float(given.get(parameter, given.get("*", known[parameter])))


def parameter_names(effect: str) -> list[str]:
    """Parameter names of an effect in the catalogue's order."""
    return [p.name for p in CATALOGUE[effect].parameters]
