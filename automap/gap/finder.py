"""``find_gaps``: from drives to findings."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from automap.effects import CATALOGUE
from automap.errors import InputError
from automap.fusion.options import FusionOptions
from automap.gap.advice import advice
from automap.gap.branches import search
from automap.gap.camera_search import CameraGap
from automap.gap.drive import GapDrive, in_vehicle_axes, open_drive
from automap.gap.effect_library import library
from automap.gap.fit import Fit, fit_drive
from automap.gap.formula_effect import adopt, name_of
from automap.gap.heldout import channel_gaps, epochs, fit_held_out, remaining_gap, total_score
from automap.gap.identifiability import Identifiability, identifiability
from automap.gap.locate import places, worst_by_channel
from automap.gap.model import GapModel, base_model
from automap.gap.result import Finding, GapResult, ParameterValue, Unexplained
from automap.gap.scoring import Joint, whitener_of
from automap.gap.search import backward_elimination, initial_state
from automap.gap.search_state import Log, State, values_of
from automap.gap.stochastic import stochastic_findings
from automap.gap.substitution import substitute_formulas

FIT_SHARE = 2.0 / 3.0
"""Without a held-out drive, so much of each drive is fitted; the rest is held out."""
MIN_PART_S = 8.0
MAX_FIT_S = 1200.0
MAX_HELD_S = 900.0
"""No more of a drive is fitted or held out: noise and effects are settled by then."""


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
    turned = [in_vehicle_axes(d, _turning_options(model.options)) for d in drives]
    held = [in_vehicle_axes(d, _turning_options(model.options)) for d in holdout]
    if not held:
        turned, held = _split(turned)
    else:
        turned = [_head(d, MAX_FIT_S) for d in turned]
        held = [_head(d, MAX_HELD_S) for d in held]
    opened = [open_drive(d, model.options) for d in turned]
    kept = [open_drive(d, model.options) for d in held]
    state = initial_state(opened, kept, model, log)
    state.exclude = frozenset(exclude)
    base = state.model
    search(state, exclude, log)
    adopt(state, log)
    joint = backward_elimination(state, log)
    if state.unexplained is None:
        substitute_formulas(state, exclude, log)
        joint = backward_elimination(state, log)
    log("measuring the gap on held-out data")
    return _result(state, base, joint)


def _turning_options(options: FusionOptions) -> FusionOptions:
    """Options for the ordinary run that finds unknown axes."""
    return replace(FusionOptions(), earth_rotation=options.earth_rotation)


def _head(drive: GapDrive, seconds: float) -> GapDrive:
    return drive if drive.length_s <= seconds else drive.part(0.0, seconds, drive.name)


def _split(drives: Sequence[GapDrive]) -> tuple[list[GapDrive], list[GapDrive]]:
    fit, held = [], []
    for drive in drives:
        length = drive.length_s
        cut = min(FIT_SHARE * length, MAX_FIT_S)
        if length - cut < MIN_PART_S:
            raise InputError(
                f"{drive.name}: {length:.0f} s are too short to hold out a part; "
                "give another drive with --holdout"
            )
        fit.append(drive.part(0.0, cut, drive.name))
        stop = min(length, cut + MAX_HELD_S)
        held.append(drive.part(cut, stop, f"{drive.name} (held out)"))
    return fit, held


def _result(
    state: State,
    base: GapModel,
    joint: Joint,
) -> GapResult:
    final_values = values_of(joint, state.accepted)
    final = fit_held_out(state.held_out, state.model, final_values, state.held_fits)
    whitener = whitener_of(state.fits[0])
    count = epochs(final)
    rest = remaining_gap(final)
    reference = total_score(final, whitener)

    def gap(fits: Sequence[Fit]) -> float:
        return rest + (reference - total_score(fits, whitener)) / count

    trail = []
    first: list[Fit] = final
    for number, (model, values) in enumerate(state.stages):
        fits = fit_held_out(state.held_out, model, values, final)
        if number == 0:
            first = fits
        trail.append(gap(fits))
    unexplained = _unexplained(state)
    effect = None if state.unexplained is None else name_of(state.unexplained)
    if unexplained is not None and effect is not None and effect in state.accepted:
        terms = tuple(
            replace(t, coefficient=value, sd=sd)
            for t, (value, sd) in zip(unexplained.terms, joint.of(effect).values(), strict=True)
        )
        unexplained = replace(
            unexplained,
            coefficient=terms[0].coefficient,
            sd=terms[0].sd,
            terms=terms,
            effect=effect,
            gap_before=trail[-1],
            gap_after=rest,
        )
    findings = []
    for trial in state.trials:
        number = trial.stage
        units = {p.name: p.unit for p in CATALOGUE[trial.effect].parameters}
        parameters = {
            p: ParameterValue(v, sd, units[p]) for p, (v, sd) in joint.of(trial.effect).items()
        }
        findings.append(
            Finding(
                trial.effect,
                parameters,
                trial.nats,
                trial.p_value,
                trail[number - 1],
                trail[number],
                state.confusable.get(trial.effect, ()),
                advice(trial.effect, state.confusable.get(trial.effect, ())),
            )
        )
    findings += [
        replace(f, confusable_with=(*f.confusable_with, *state.confusable.get(f.effect, ())))
        for f in stochastic_findings(state.fits, state.stated_factors, rest, state.exclude)
    ]
    found = places(first, final)
    model = replace(state.model, values={**state.model.values, **final_values})
    return GapResult(
        trail[0],
        rest,
        channel_gaps(first, final, worst_by_channel(found)),
        tuple(findings),
        dict(state.model.factors),
        unexplained,
        _verdict(findings, trail[0], rest, unexplained),
        model,
        base,
        warnings=(*state.warnings, *state.refused.values()),
        places=tuple(found),
        held_out=(tuple(first), tuple(final)),
        unclear=_unclear(state, model),
    )


def _unclear(state: State, model: GapModel) -> Identifiability:
    """What the fitted drives cannot tell, the accepted effects held at their values."""
    fits = state.fits
    if state.accepted:
        fits = [
            fit_drive(d, model, linearised_at=f) for d, f in zip(state.drives, fits, strict=True)
        ]
    wheels = any(d.session.odometer is not None for d in state.drives)
    effects = library(frozenset(state.exclude), wheels, model.options.earth_rotation)
    return identifiability(fits, effects)


def with_cameras(
    result: GapResult, cameras: Sequence[CameraGap], warnings: Sequence[str] = ()
) -> GapResult:
    """The result with what was found about the cameras."""
    findings = (*result.findings, *(f for c in cameras for f in c.findings))
    sentences = (*result.warnings, *warnings, *(t for c in cameras for t in c.warnings))
    verdict = result.verdict
    if len(findings) > len(result.findings):
        after, before = result.gap_after, result.gap_before
        verdict = _verdict(result.findings, before, after, result.unexplained)
        names = ", ".join(f.effect for c in cameras for f in c.findings)
        shrunk = ", ".join(
            f"from {c.gap_before:.3g} to {c.gap_after:.3g} nats a box"
            for c in cameras
            if c.findings
        )
        text = f"missing from the camera: {names}; with it the gap on held-out signs falls {shrunk}"
        nothing = not result.findings and result.unexplained is None
        verdict = text if nothing else f"{verdict}; {text}"
    return replace(result, findings=findings, warnings=sentences, verdict=verdict)


def _unexplained(state: State) -> Unexplained | None:
    formula = state.unexplained
    if formula is None:
        return None
    return Unexplained(
        formula.channel,
        formula.equation,
        formula.coefficient,
        formula.sd,
        formula.evidence.nats,
        formula.p_value,
        state.resembles,
        terms=formula.terms,
    )


def _verdict(
    findings: Sequence[Finding], before: float, after: float, unexplained: Unexplained | None
) -> str:
    if unexplained is not None:
        text = "something that no effect of the library explains is missing from the model"
        if findings:
            names = ", ".join(f.effect for f in findings)
            text = f"missing from the model: {names}; and {text}"
        return (
            f"{text}; what fits best is {unexplained.formula} with {unexplained.numbers} "
            f"({unexplained.evidence_nats:.0f} nats); with it the "
            f"gap on held-out data falls from {before:.3g} to {after:.3g} nats an epoch"
        )
    if not findings:
        return "nothing is missing from the model as far as these drives can show"
    names = ", ".join(f.effect for f in findings)
    return (
        f"missing from the model: {names}; with it the gap on held-out data falls from "
        f"{before:.3g} to {after:.3g} nats an epoch"
    )
