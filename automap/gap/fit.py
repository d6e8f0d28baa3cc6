"""The model whose gap is measured (nuisances, values carried over, levels of noise), and its fit to
one drive: smoothed trajectory, innovations, the estimated effects."""

from __future__ import annotations

import sys
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from automap.effects import CATALOGUE
from automap.effects.entries.installation import EARTH
from automap.effects.terms import POSITION, Kind
from automap.fusion.delay_states import DELAY_STATE, LATENCY_STATE
from automap.fusion.filtered import full_covariance
from automap.fusion.kernel_runs import Start
from automap.fusion.layout import N_NAV
from automap.fusion.levels import ALL_LEVELS
from automap.fusion.options import FusionOptions
from automap.fusion.passes import Pass, Session, run_passes
from automap.fusion.relinearise import relinearise
from automap.gap.drive import OpenDrive
from automap.gap.lean import LEANS, told_by_weight
from automap.gap.motion import (
    Delays,
    delays_of,
    has_delays,
    linear_in_delays,
    motion_of,
)
from automap.records import FloatArray, IntArray

Values = Mapping[str, Mapping[str, float]]

BEHIND = "gnss_course_distance"
"""Courses of a place behind the antenna's."""
ALWAYS = (BEHIND, "gnss_speed_offset", "vehicle_pitch")
"""What every receiver and every vehicle has, whatever else is asked: courses that lag at low speed,
speeds that are told too low, and springs."""
BASE_NUISANCES = ("accel_bias", "gyro_bias", "gnss_correlated_noise", "gnss_multipath", *ALWAYS)
"""What the base model estimates on every drive anew: every receiver's positions err for minutes
and for seconds."""

SKEW, ORIGIN = "imu_clock_skew", "origin"
"""A clock that runs fast, and what it was off by when the drive began."""
CONSTANTS = ("imu_time_offset", "gnss_latency")
"""Names of such a constant."""
ARM = "gnss_lever_arm"
DELAY_ROUNDS = 8


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
    """The options with what every vehicle and every receiver has among the nuisances: springs,
    courses that lag at low speed, speeds that are told too low."""
    more = [e for e in ALWAYS if e not in options.effects and e not in options.fixed]
    return replace(options, effects=(*options.effects, *more))


def without(model: GapModel, effect: str) -> GapModel:
    """A model that does not estimate an effect."""
    effects = tuple(e for e in model.options.effects if e != effect)
    return replace(model, options=replace(model.options, effects=effects))


def plain_options(options: FusionOptions) -> FusionOptions:
    """The options for passes whose noise is given, not adapted."""
    return replace(options, adapt=False, tune=False, fixed={}, retime=False, nhc_mean_s=0.0)


def prior_sd(options: FusionOptions, effect: str, parameter: str) -> float:
    """One sigma of a parameter before the drive: the options', else the catalogue's."""
    given = options.prior_sd.get(effect, {})
    known = {p.name: p.prior_sd for p in CATALOGUE[effect].parameters}
    return float(given.get(parameter, given.get("*", known[parameter])))


def parameter_names(effect: str) -> list[str]:
    """Parameter names of an effect in the catalogue's order."""
    return [p.name for p in CATALOGUE[effect].parameters]


@dataclass(frozen=True)
class Fit:
    """A model on a drive.

    ``values`` [p] and ``cov`` [p, p] of the estimated effects' parameters, ``names`` as
    (effect, parameter); ``score`` the log-likelihood in nats, marginal over all states; ``delays``
    what was taken out of the fixes beyond the first order.
    """

    opened: OpenDrive
    model: GapModel
    last: Pass
    start: Start
    names: tuple[tuple[str, str], ...]
    values: FloatArray
    cov: FloatArray
    score: float
    delays: Delays = field(default_factory=Delays)


def fit_drive(
    opened: OpenDrive,
    model: GapModel,
    estimate: Mapping[str, float] | None = None,
    linearised_at: Fit | None = None,
) -> Fit:
    """Run the passes under the model, with the effects ``estimate`` (effect -> factor on the
    prior sd) as states and all others of the model at their values.

    ``linearised_at`` another model's fit to the same drive: the passes begin about its path.
    """
    estimate = estimate or {}
    session, where = session_with(opened, model, estimate)
    if LEANS[0] in estimate and linearised_at is not None:
        session = told_by_weight(session, linearised_at.last)
    delays = Delays()
    if linearised_at is None:
        last, found = run_passes(session, None, constrained=True)
        start = found.start
    else:
        last, start = linearised_at.last, linearised_at.start
        if linearised_at.delays != delays and has_delays(session.options.effects):
            delays = linearised_at.delays
        last, start = _repeat_passes(session, last, start, delays)
    for _ in range(DELAY_ROUNDS):
        found_delays = delays_of(last, where)
        if found_delays.close_to(delays, session.span[1]):
            break
        delays = found_delays
        last, start = _repeat_passes(session, last, start, delays)
    model_names = last.problem.model.names
    n = last.problem.model.size
    names, rows, signs = [], [], []
    for effect in estimate:
        for parameter in parameter_names(effect):
            state, sign = where[effect][parameter]
            names.append((effect, parameter))
            rows.append(model_names.index(state))
            signs.append(sign)
    final = np.array([last.totals()[name] for name in model_names])
    sign_row = np.array(signs)
    at = np.array(rows, dtype=np.int64)
    values = sign_row * final[at] - _stated(opened, names)
    cov = full_covariance(last.forward.store.cov[-1:], n)[0]
    part = cov[np.ix_(at + N_NAV, at + N_NAV)] * np.outer(sign_row, sign_row)
    # many fits are held, and of their covariances nothing is asked but the last
    store = last.forward.store._replace(cov=last.forward.store.cov[-1:].copy())
    last = replace(last, forward=replace(last.forward, store=store))
    return Fit(
        opened,
        model,
        last,
        start,
        tuple(names),
        values,
        part,
        float(last.forward.score),
        delays=delays,
    )


def session_with(
    opened: OpenDrive, model: GapModel, estimate: Mapping[str, float]
) -> tuple[Session, dict[str, dict[str, tuple[str, float]]]]:
    """The drive's session under a model, with the effects ``estimate`` as states.

    ``estimate`` maps effect to a factor on its prior sd. Returned with it: effect -> parameter
    -> (name of its state, sign).
    """
    drive, session = opened.drive, opened.session
    options = model.options
    effects = [e for e in options.effects if e not in model.values]
    means, sds = dict(session.means), dict(session.sds)
    stated = np.zeros(3) if drive.lever_arm is None else np.asarray(drive.lever_arm)
    if drive.delay.sd > 0.0 or drive.delay.mean != 0.0:
        effects.append("imu_time_offset")
        means[DELAY_STATE], sds[DELAY_STATE] = drive.delay.mean, drive.delay.sd
    if drive.mounting_sd.any() and "imu_mounting" not in effects:
        effects.append("imu_mounting")
        for a, sd in zip(("roll", "pitch", "yaw"), drive.mounting_sd, strict=True):
            sds[f"imu_mounting_{a}"] = float(sd)
    where: dict[str, dict[str, tuple[str, float]]] = {}
    earth = options.earth_rotation or EARTH in model.values or EARTH in estimate
    for effect in dict.fromkeys([*model.values, *estimate]):
        if effect == EARTH:
            where[effect] = {}
            continue
        state, sign = CATALOGUE[effect].first_order or (effect, 1.0)
        if state not in effects:
            effects.append(state)
        place = {}
        state_parameters = parameter_names(state)
        for i, parameter in enumerate(parameter_names(effect)):
            name = f"{state}_{state_parameters[i]}"
            place[parameter] = (name, sign)
            means[name] = means.get(name, 0.0) + sign * float(
                model.values.get(effect, {}).get(parameter, 0.0)
            )
            sd = estimate.get(effect, 0.0) * prior_sd(options, effect, parameter)
            sds[name] = float(np.hypot(sds.get(name, 0.0), sd))
        where[effect] = place
    if SKEW in where:
        # nobody says at which instant the two clocks agreed
        if "gnss_latency" not in effects:
            effects.append("gnss_latency")
        value = abs(model.values.get(SKEW, {}).get("skew", 0.0))
        value += estimate.get(SKEW, 0.0) * prior_sd(options, SKEW, "skew")
        free = options.prior_sd.get(SKEW, {}).get(ORIGIN, value * session.span[1])
        means.setdefault(LATENCY_STATE, 0.0)
        sds[LATENCY_STATE] = float(np.hypot(sds.get(LATENCY_STATE, 0.0), free))
    if stated.any() or ARM in effects:
        if ARM not in effects:
            effects.append("gnss_lever_arm")
        for a, value in zip("xyz", stated, strict=True):
            name = f"gnss_lever_arm_{a}"
            means[name] = means.get(name, 0.0) + float(value)
            if "gnss_lever_arm" not in where and "gnss_lever_arm" not in options.effects:
                sds[name] = 0.0
    scaled = replace(
        options, effects=tuple(effects), factors=dict(model.factors), earth_rotation=earth
    )
    session = replace(session, options=scaled, means=means, sds=sds)
    # the whole filter is looked into, however long the drive
    return replace(session, section_nodes=sys.maxsize), where


def whitened_innovations(fit: Fit) -> tuple[FloatArray, FloatArray, IntArray]:
    """Innovations over sd [s], their times [s] in s and channels [s]."""
    store = fit.last.forward.store
    node, channel = store.info[:, 0], store.info[:, 1]
    return store.nu / np.sqrt(store.var), fit.last.nodes.t[node], channel


def _repeat_passes(
    session: Session, last: Pass, start: Start, delays: Delays
) -> tuple[Pass, Start]:
    """The passes again about the path of ``last``, without what ``delays`` do to the fixes beyond
    the first order."""
    if delays != Delays():
        unknown = _arm_unknown(session)
        fixes, change = linear_in_delays(session.fixes, last, motion_of(last), delays, unknown)
        # what acts with the speed acts at once, whenever a fix tells of it
        path = last.nodes.t, np.ascontiguousarray(last.smooth.nominal[:, 3:6])
        session = replace(session, fixes=fixes, late_change=change, path=path)
    return relinearise(session, last, start)


def _arm_unknown(session: Session) -> bool:
    """Whether a session has to find where the antenna is, or by a formula how far it has moved."""
    known = not any(session.sds.get(f"{ARM}_{a}", 1.0) > 0.0 for a in "xyz")
    movers = [
        effect
        for effect in session.options.effects
        if any(term.kind == Kind.POINT and term.on == POSITION for term in CATALOGUE[effect].terms)
    ]
    return any(effect != ARM or not known for effect in movers)


def _stated(opened: OpenDrive, names: list[tuple[str, str]]) -> FloatArray:
    """What the manifest already says of the parameters: only the lever arm has such."""
    arm = opened.drive.lever_arm
    known = {} if arm is None else dict(zip("xyz", np.asarray(arm), strict=True))
    return np.array([known.get(p, 0.0) if e == "gnss_lever_arm" else 0.0 for e, p in names])
