"""``find_gaps``: from drives to findings."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

from automap.errors import InputError
from automap.fusion.options import FusionOptions
from automap.gap import limits
from automap.gap.base_fit import first_fit
from automap.gap.camera.search import CameraGap
from automap.gap.candidates import library
from automap.gap.constancy import drifts
from automap.gap.costs import costs
from automap.gap.doubt import (
    doubt_of_usual,
    doubts,
    in_noise,
    strongest_refused,
    suspected,
)
from automap.gap.drive import GapDrive, OpenDrive, in_vehicle_axes, open_drive, with_shocks
from automap.gap.fit import Fit, GapModel, Values, base_model, fit_drive
from automap.gap.formula_effects import forget_formulas
from automap.gap.found import Beside, Found
from automap.gap.linear import Column
from automap.gap.misfit import Misfit, Place, misfits, places, worst_by_channel
from automap.gap.naming import (
    Identifiability,
    chance,
    describe,
    identifiability,
    verdict,
)
from automap.gap.nodes import NodeMotion
from automap.gap.noise import Log
from automap.gap.noise_levels import Levels
from automap.gap.reading_steps import coarse_readings
from automap.gap.receivers import outliers_finding, usual_findings, values_for_runs
from automap.gap.responses import responses
from automap.gap.result import (
    ChannelGap,
    Cost,
    Drift,
    Finding,
    HeldPositions,
    KeptOut,
    NoiseClaim,
    Refused,
    Unexplained,
    advice,
)
from automap.gap.scoring import (
    channel_gaps,
    epochs,
    fit_held_out,
    gain_over,
    remaining_gap,
    whitener_of,
)
from automap.gap.screening import Screening
from automap.gap.search import Search
from automap.gap.stochastic import noise_claims, noise_levels, stochastic_findings


@dataclass(frozen=True)
class GapResult:
    """Everything that a search found.

    ``formulas`` what no effect of the library explains, ``model`` the new one, ``places`` where the
    gap was, ``held_out`` the fits of the held-out data before and after, ``unclear`` what the
    fitted drives cannot tell, ``misfits`` what no candidate explains, ``noise_claims`` noise that
    is not as stated, ``refused`` the strongest candidate that is not named, ``costs`` what each
    effect by name, or level of noise, costs on held-out data, ``kept_out`` what these spoke
    against, ``positions`` how well they are predicted.
    """

    gap_before: float
    gap_after: float
    channels: tuple[ChannelGap, ...]
    findings: tuple[Finding, ...]
    noise: Mapping[str, float]
    formulas: tuple[Unexplained, ...]
    verdict: str
    model: GapModel
    base: GapModel
    sync: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    places: tuple[Place, ...] = ()
    held_out: tuple[tuple[Fit, ...], tuple[Fit, ...]] = ((), ())
    unclear: Identifiability = field(default_factory=Identifiability)
    misfits: tuple[Misfit, ...] = ()
    noise_claims: tuple[NoiseClaim, ...] = ()
    refused: tuple[Refused, ...] = ()
    costs: Mapping[str, Cost] = field(default_factory=dict)
    kept_out: tuple[KeptOut, ...] = ()
    positions: HeldPositions | None = None


def find_gaps(
    drives: Sequence[GapDrive],
    holdout: Sequence[GapDrive] = (),
    model: GapModel | None = None,
    exclude: Collection[str] = (),
    log: Log = lambda text: None,
) -> GapResult:
    """Find what the model of the drives is missing, name it, and show the gap shrink.

    ``drives`` recordings that are fitted, ``holdout`` others that are not (without any, the last
    third of each drive is held out); ``model`` whose gap is wanted, default ``base_model()``;
    ``exclude`` effects that the library is to do without; ``log`` receives what is going on.

    Raises:
        InputError: no drive, or one that has too little data.
    """
    if not drives:
        raise InputError("no drive to look at; give at least one")
    model = model or base_model()
    turning = replace(FusionOptions(), earth_rotation=model.options.earth_rotation)
    turned = [in_vehicle_axes(d, turning) for d in drives]
    held = [in_vehicle_axes(d, turning) for d in holdout]
    if not held:
        turned, held = _split(turned)
    else:
        turned = [_head(d, limits.MAX_FIT_S) for d in turned]
        held = [_head(d, limits.MAX_HELD_S) for d in held]
    opened = [open_drive(d, model.options) for d in turned]
    kept = [open_drive(d, model.options) for d in held]
    forget_formulas(())
    base = first_fit(opened, model, log)
    if base.model.options.shocks:
        kept = [with_shocks(d) for d in kept]
    search = Search(base, kept, model.factors, exclude, log)
    found = search.run()
    log("measuring the gap on held-out data")
    forget_formulas(found.fitted.estimate)
    return _result(found, search.screening, kept, model, exclude)


def _head(drive: GapDrive, seconds: float) -> GapDrive:
    return drive if drive.length_s <= seconds else drive.part(0.0, seconds, drive.name)


def _split(drives: Sequence[GapDrive]) -> tuple[list[GapDrive], list[GapDrive]]:
    fit, held = [], []
    for drive in drives:
        length = drive.length_s
        cut = min(limits.FIT_SHARE * length, limits.MAX_FIT_S)
        if length - cut < limits.MIN_PART_S:
            raise InputError(
                f"{drive.name}: {length:.0f} s are too short to hold out a part; "
                "give another drive with --holdout"
            )
        fit.append(drive.part(0.0, cut, drive.name))
        stop = min(length, cut + limits.MAX_HELD_S)
        held.append(drive.part(cut, stop, f"{drive.name} (held out)"))
    return fit, held


def _result(
    found: Found,
    screening: Screening,
    held_out: Sequence[OpenDrive],
    stated: GapModel,
    exclude: Collection[str],
) -> GapResult:
    """Everything that is told of a search with its ``screening``."""
    model, base, stands = found.fitted.model, found.base.model, found.stands
    values = stands.values
    maxima = chance(found)
    final = fit_held_out(held_out, model, values)
    rest = remaining_gap(final)
    as_told = replace(model, values={**model.values, **values})
    fits = [fit_drive(f.opened, as_told, linearised_at=f) for f in found.fitted.fits]
    always = usual_findings(found, values, held_out, final, stated.factors, rest, exclude)
    changing, later = _followed(found, screening, fits, final, values, tuple(always))
    told = describe(found, values, maxima, changing, doubts(found, values, changing))
    whitener, count = whitener_of(final[0]), epochs(final)
    first = fit_held_out(held_out, base, {}, final)
    gaps = [rest + gain_over(final, first, whitener) / count]
    for number in range(1, len(told)):
        part = {e: v for e, v in values.items() if e in {t.effect for t in told[:number]}}
        then = fit_held_out(held_out, model, part, final)
        gaps.append(rest + gain_over(final, then, whitener) / count)
    gaps.append(rest)
    between = zip(told, pairwise(gaps), strict=False)
    told = [replace(one, gap_before=then, gap_after=now) for one, (then, now) in between]
    findings = [one for one in told if isinstance(one, Finding)]
    formulas = [one for one in told if isinstance(one, Unexplained)]
    usual = []
    for effect, (one, bare) in always.items():
        drift = changing.get(effect)
        instead = str(drift or one.resembles or doubt_of_usual(found, screening, bare, effect))
        usual.append(replace(one, resembles=instead, drift=drift))
    findings += usual
    with_states = found.fitted.fits
    under = Levels(with_states, found.fitted.curvature)
    noise = [
        replace(f, confusable_with=also, advice=advice(f.effect, also))
        for f in stochastic_findings(under, stated.factors, rest, frozenset(exclude))
        for also in (tuple(found.as_drift.get(f.effect, ())),)
    ]
    wild = outliers_finding(with_states, rest)
    if wild is not None and wild.effect not in exclude:
        noise.append(wild)
    findings += noise
    claims = noise_claims(under, stated.factors, final, stated.options.shocks)
    refused = strongest_refused(found)
    kept_out = _by_formula(found, stands.kept_out)
    hidden = in_noise(found, screening, stated.factors)
    likened = {m.where: m for m in (*suspected((*refused, *hidden)), *later)}
    left = (*misfits(with_states), *likened.values())
    noisy = {n: noise_levels(n) for n in (*(f.effect for f in noise), *(c.level for c in claims))}
    paid = costs(held_out, final, values, noisy, stated.factors, stands.without)
    shown = places(first, final)
    carried = replace(model, values={**as_told.values, **values_for_runs(usual)})
    return GapResult(
        gaps[0],
        rest,
        channel_gaps(first, final, worst_by_channel(shown)),
        tuple(findings),
        dict(model.factors),
        tuple(formulas),
        verdict(findings, formulas, left, gaps[0], rest, kept_out, claims),
        carried,
        base,
        warnings=(*stands.warnings, *coarse_readings(with_states)),
        places=tuple(shown),
        held_out=(tuple(first), tuple(final)),
        unclear=_unclear(fits, model, exclude),
        misfits=left,
        noise_claims=claims,
        refused=refused,
        costs=paid,
        kept_out=kept_out,
        positions=stands.positions,
    )


def _by_formula(found: Found, kept_out: Sequence[KeptOut]) -> tuple[KeptOut, ...]:
    """Formulas by what they say: the effects that stood for them are forgotten."""
    says = {effect: name for name, effect in found.effects.items()}
    return tuple(replace(one, effect=says.get(one.effect, one.effect)) for one in kept_out)


def _followed(
    found: Found,
    screening: Screening,
    fitted: Sequence[Fit],
    held_out: Sequence[Fit],
    values: Values,
    usual: Sequence[str],
) -> tuple[dict[str, Drift], tuple[Misfit, ...]]:
    """Which named effects, and which ``usual`` ones, are not constant, and what follows manoeuvres
    in a way of its own, by fits of all drives with the effects held at ``values``."""
    chosen = found.chosen
    for name in chosen.names:
        if found.effects.get(name, name) not in values:
            chosen = chosen.without(name)

    def columns(at: NodeMotion) -> Iterator[Column]:
        return screening.columns(at, chosen.names)

    names = {effect: name for name, effect in found.effects.items()}
    known = {names.get(effect, effect): its for effect, its in values.items()}
    asked = Beside(found.selection, chosen, columns, known)
    later = responses(asked, fitted, held_out)
    return drifts(asked, (*fitted, *held_out), usual), later


def _unclear(fits: Sequence[Fit], model: GapModel, exclude: Collection[str]) -> Identifiability:
    """What the fitted drives cannot tell, the effects held at their values."""
    wheels = any(f.opened.session.odometer is not None for f in fits)
    effects = library(frozenset(exclude), wheels, model.options.earth_rotation)
    return identifiability(fits, effects)


def with_cameras(
    result: GapResult, cameras: Sequence[CameraGap], warnings: Sequence[str] = ()
) -> GapResult:
    """The result with what was found about the cameras."""
    findings = (*result.findings, *(f for c in cameras for f in c.findings))
    sentences = (*result.warnings, *warnings, *(t for c in cameras for t in c.warnings))
    text = result.verdict
    if len(findings) > len(result.findings):
        names = ", ".join(f.effect for c in cameras for f in c.findings)
        shrunk = ", ".join(
            f"from {c.gap_before:.3g} to {c.gap_after:.3g} nats a box"
            for c in cameras
            if c.findings
        )
        more = f"missing from the camera: {names}; with it the gap on held-out signs falls {shrunk}"
        nothing = not result.findings and not result.formulas and not result.misfits
        text = more if nothing else f"{text}; {more}"
    return replace(result, findings=findings, warnings=sentences, verdict=text)
