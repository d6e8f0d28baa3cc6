"""From what a search chose to what is told: names, values, evidence, and what else it may be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from automap.effects import CATALOGUE
from automap.gap import limits
from automap.gap.candidates import twins_of
from automap.gap.chance import null_maxima, p_value
from automap.gap.columns import named_columns
from automap.gap.evidence import between_channels
from automap.gap.fit import ORIGIN, Fit, Values
from automap.gap.found import Found
from automap.gap.limits import ALIKE, SHOWS
from automap.gap.linear import Part
from automap.gap.misfit import Misfit
from automap.gap.nodes import motions_of
from automap.gap.result import (
    Drift,
    Finding,
    KeptOut,
    NoiseClaim,
    ParameterValue,
    Term,
    Unexplained,
    advice,
    coefficient_names,
)
from automap.gap.selection import Chosen, Selection
from automap.gap.sensitivity import linearised
from automap.gap.stepwise import Rival, rivals, told_apart
from automap.records import FloatArray, IntArray


def describe(
    found: Found,
    values: Values,
    maxima: FloatArray,
    drifting: Mapping[str, Drift],
    doubts: Mapping[str, str],
) -> list[Finding | Unexplained]:
    """Findings and formulas of a search that stand with ``values``, the surest first; their gaps
    are filled in later. ``maxima`` [draws] what chance reaches, ``drifting`` the effects that are
    not constant, ``doubts`` what the named ones may be instead."""
    selection, chosen = found.selection, found.chosen
    told: list[tuple[float, Finding | Unexplained]] = []
    against = {one.effect for one in found.stands.kept_out}
    names = [c.name for c in selection.candidates.values() if not c.terms and c.name not in against]
    for name in chosen.names:
        effect = found.effects.get(name, name)
        if effect not in values:
            continue
        odds, moves = selection.odds_of(chosen, name)
        rivals = _in_place(selection, chosen, name, names, odds)
        close = [r.name for r, apart in rivals if not apart]
        # one axis may be another effect's, though not all are, if it is worth a name by itself
        known = selection.candidates[name]
        dear = limits.LEAST_ODDS - known.log_prior - known.log_choice
        for move in (m for m in moves if len(moves) > 1 and m.evidence.nats >= dear):
            places = _in_place(selection, chosen, name, names, move.odds, move.part)
            close += [r.name for r, apart in places if not apart]
        close += found.not_told_apart.get(name, ())
        # a noise that was fitted beside an effect does not know what it would say without it
        linear = sum(m.evidence.nats for m in moves)
        nats = found.nats.get(name, linear)
        sure = odds - linear + nats
        p = p_value(nats - np.log(selection.candidates[name].choices), maxima)
        if selection.candidates[name].terms:
            nearest = rivals[0][0].name if rivals else None
            told.append((sure, _formula(found, name, nats, p, nearest)))
            continue
        twins = [t for t in sorted(twins_of((name,))) if t in selection.candidates]
        confusable = tuple(dict.fromkeys([*close, *twins]))
        units = {q.name: q.unit for q in CATALOGUE[effect].parameters}
        parameters = {
            q: ParameterValue(v, _honest_sd(found, name, q, sd), units[q])
            for q, (v, sd) in found.full.of(effect).items()
        }
        its = (effect, parameters, nats, p, 0.0, 0.0, confusable, advice(effect, confusable))
        told.append((sure, Finding(*its, doubts.get(name, ""), drifting.get(name))))
    return [one for _, one in sorted(told, key=lambda item: -item[0])]


def _in_place(
    selection: Selection,
    chosen: Chosen,
    name: str,
    names: Sequence[str],
    odds: float,
    part: Part | None = None,
) -> list[tuple[Rival, bool]]:
    """Which of ``names`` may stand in the place of a chosen candidate, or of a ``part`` of it, with
    log odds ``odds``, and whether they are told apart. What was tried beside other candidates than
    these and was not needed there may be one of them."""
    room = max(limits.CLOSE_NATS, limits.CLOSE * odds)
    return [
        (r, r.ahead < -room and told_apart(selection, r, chosen, name, part))
        for r in rivals(selection, chosen, name, names, frozenset(), part)
        if r.chosen != chosen and r.name not in chosen.names
    ]


def _honest_sd(found: Found, name: str, parameter: str, sd: float) -> float:
    """The filter's sd of a parameter, wider by as much as its score scatters from stretch to
    stretch beyond what noise as modelled does (the sandwich of White 1980), or as the channels
    contradict one another about it; what the prior says of it stays."""
    selection, chosen = found.selection, found.chosen
    layout = selection.linear.layout
    mine = [i for i, c in enumerate(layout) if c.effect == name and c.parameter == parameter]
    if not mine or sd <= 0.0:
        return sd
    part = next((p for n, p, _ in chosen.parts if n == name and mine[0] in p), (mine[0],))
    rest = Chosen(tuple(p for p in chosen.parts if p[:2] != (name, part)))
    known = selection.given(rest)
    if not known.shows(part):
        return sd
    ratio = selection.evidence(known, name, part).overdispersion
    ratio = between_channels(selection.with_free(known, name), part, ratio)
    prior = 1.0 / (chosen.scale_of(name) * selection.linear.prior_sd[mine[0]]) ** 2
    data = max(1.0 / sd**2 - prior, 0.0)
    return float(sd**2 * np.sqrt(ratio * data + prior))


def chance(found: Found) -> FloatArray:
    """The largest evidence [draws] of all candidates beside what was found where nothing else is
    missing, sorted."""
    selection = found.selection
    known = selection.given(found.chosen)
    # the likeliest of many have paid for that: what they then reach by chance, others do
    once = [c for c in selection.candidates.values() if c.choices == 1.0]
    parts = [p for c in once for p in c.parts if known.shows(p)]
    return null_maxima(known, parts, limits.NULL_DRAWS)


def _formula(found: Found, name: str, nats: float, p: float, nearest: str | None) -> Unexplained:
    candidate = found.selection.candidates[name]
    effect = found.effects[name]
    joint = found.fitted.joint().of(effect)
    names = coefficient_names(len(candidate.terms))
    terms = tuple(
        Term(on, text, value, _honest_sd(found, name, k, sd))
        for k, (on, text) in zip(names, candidate.terms, strict=True)
        for value, sd in (joint.get(k, (0.0, 0.0)),)
    )
    first = terms[0]
    told = first.channel, name, first.coefficient, first.sd, nats, p, nearest, effect
    others = found.not_told_apart.get(name, ())
    return Unexplained(*told, terms=terms, confusable_with=others)


def verdict(
    findings: Sequence[Finding],
    formulas: Sequence[Unexplained],
    left: Sequence[Misfit],
    before: float,
    after: float,
    kept_out: Sequence[KeptOut] = (),
    claims: Sequence[NoiseClaim] = (),
) -> str:
    """What is missing, in a sentence; what only the fitted data show is no silence, and neither is
    noise beyond what is stated."""
    parts = []
    if findings:
        others = [" or ".join(filter(None, (f.resembles, f.same_as))) for f in findings]
        names = [
            f.effect + (f" (or {other})" if other else "")
            for f, other in zip(findings, others, strict=True)
        ]
        parts.append(f"missing from the model: {', '.join(names)}")
    for one in formulas:
        like = f", which resembles {one.resembles}" if one.resembles else ""
        same = f", or {one.same_as}" if one.same_as else ""
        parts.append(
            "something that no effect of the library explains is missing from the model"
            f"; what fits best is {one.formula} with {one.numbers} "
            f"({one.evidence_nats:.0f} nats){like}{same}"
        )
    if parts:
        parts.append(
            f"with it the gap on held-out data falls from {before:.3g} to {after:.3g} nats an epoch"
        )
    if left:
        worst = left[0]
        also = " also" if parts else ""
        more = f", and {len(left) - 1} more" if len(left) > 1 else ""
        parts.append(f"something is{also} missing that no candidate explains: {worst}{more}")
    against = [one.effect for one in kept_out if not one.each_drive]
    if against:
        parts = parts or ["nothing that held-out data bear out is missing from the model"]
        parts.append(
            "not taken, since the fitted data speak for it and the held-out data against: "
            f"{', '.join(against)}"
        )
    told = [c for c in claims if c.condition or not (findings or formulas or left)]
    if told:
        parts = parts or ["no effect that these drives can show is missing from the model"]
        levels = ", ".join(map(str, told))
        unknown = "" if all(c.cause for c in told) else ", and what makes it is not told"
        parts.append(f"but noise is not as stated{unknown}: {levels}")
    return "; ".join(parts) or "nothing is missing from the model as far as these drives can show"


@dataclass(frozen=True)
class Alike:
    """Two effects that a drive cannot tell apart, the share of the one's traces that the other
    leaves as well, and the manoeuvre that would tell."""

    effects: tuple[str, str]
    share: float
    advice: str


@dataclass(frozen=True)
class Identifiability:
    """``alike`` pairs, the most alike first; ``hidden`` effects that hardly show on the drive even
    at their usual size."""

    alike: tuple[Alike, ...] = ()
    hidden: tuple[str, ...] = ()


def identifiability(fits: Sequence[Fit], effects: Sequence[str]) -> Identifiability:
    """What the fitted drives together cannot tell of the effects."""
    info, layout, priors = _information(fits, effects)
    groups = {
        e: np.array([i for i, (name, _) in enumerate(layout) if name == e], np.int64)
        for e in effects
    }
    seen = priors * np.sqrt(np.maximum(np.diag(info), 0.0)) > SHOWS
    shown = {e: rows[seen[rows]] for e, rows in groups.items() if seen[rows].any()}
    found: dict[frozenset[str], Alike] = {}
    for one, rows in shown.items():
        for other in shown:
            if other == one:
                continue
            share = _share(info, rows, groups[other], priors)
            pair = frozenset({one, other})
            if share > 0.0 and (pair not in found or share > found[pair].share):
                found[pair] = Alike((one, other), share, advice(one, (other,)))
    alike = sorted(found.values(), key=lambda a: -a.share)
    return Identifiability(tuple(alike), tuple(e for e in effects if e not in shown))


def _information(
    fits: Sequence[Fit], effects: Sequence[str]
) -> tuple[FloatArray, list[tuple[str, str]], FloatArray]:
    """Information [c, c] of all parameters, their names, and prior sds [c]."""
    linear = linearised(motions_of(fits), lambda at: named_columns(effects, at), {})
    # a skew's origin is no parameter of its own
    kept = [i for i, c in enumerate(linear.layout) if c.parameter != ORIGIN]
    layout = [(linear.layout[i].effect, linear.layout[i].parameter) for i in kept]
    return linear.info[np.ix_(kept, kept)], layout, linear.prior_sd[kept]


def _share(info: FloatArray, rows: IntArray, other: IntArray, priors: FloatArray) -> float:
    """The largest share of what one of ``rows`` shows that the ``other`` columns show too; zero
    where they can be told apart."""
    inner = info[np.ix_(other, other)] + np.diag((max(limits.PRIOR_SCALES) * priors[other]) ** -2.0)
    cross = info[np.ix_(rows, other)]
    explained = np.einsum("ij,ij->i", cross, np.linalg.solve(inner, cross.T).T)
    own = np.maximum(np.diag(info)[rows], 1e-300)
    left = priors[rows] * np.sqrt(np.maximum(own - explained, 0.0))
    share = np.where(left < SHOWS, explained / own, 0.0)
    return float(np.max(np.where(share > ALIKE, share, 0.0)))
