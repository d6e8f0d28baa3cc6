"""What a search found in words, for who measures and is no statistician.

One paragraph for each finding, as (what is wrong, the rest): how sure that is, what it costs on
the held-out drive, what to do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from automap.effects import CATALOGUE, Effect
from pipeline.gap.effect_words import as_clause, in_a_word, listed, sentence_case, what_is_wrong
from pipeline.gap.misfit_words import misfit_words
from pipeline.gap.model import left_to_runs
from pipeline.gap.remedies import MODEL, TAKE_MODEL, remedy
from pipeline.gap.sizes import about, with_sd

if TYPE_CHECKING:
    from automap.gap import Finding, GapResult, Unexplained
    from automap.gap.result import Cost, Drift, HeldPositions, KeptOut, NoiseClaim

MILLION = 1e6
SURE = (
    (math.log(MILLION) + math.log(1e3), 1.0 / MILLION, "practically certain"),
    (math.log(1e4), 1e-3, "very likely"),
    (math.log(1e2), 5e-2, "likely"),
)
"""Nats, p-value and words: both must be as good. The odds that the data give must outweigh some
hundreds of candidates that are each unlikely beforehand, hence a thousand more than a million."""
LEAST_M, LEAST_DEG = 0.001, 0.001
"""Differences below these no survey sees."""
FEW = 3
NUMBERS = ("No", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine")

Paragraph = tuple[str, str]
LEVELS = {
    "accel": "The accelerometer's noise",
    "gyro": "The gyro's noise",
    "position_h": "The error of the receiver's level positions",
    "position_v": "The error of the receiver's heights",
    "velocity_h": "The error of the receiver's level velocities",
    "velocity_v": "The error of the receiver's vertical velocities",
}


def in_words(result: GapResult) -> list[Paragraph]:
    """All that a search found, and what is left."""
    out = [_overview(result)]
    left = left_to_runs(result)
    for f in result.findings:
        to_do = _without(f.effect, left[f.effect]) if f.effect in left else ""
        out.append(finding_words(f, result.costs.get(f.effect), to_do))
    out += [formula_words(f, result.costs.get(f.effect or "")) for f in result.formulas]
    out += [noise_words(c, result.costs.get(c.level)) for c in result.noise_claims]
    out += [kept_out_words(one) for one in result.kept_out]
    if result.misfits:
        out.append(misfit_words(result.misfits, result.held_out[1]))
    return out


def finding_words(finding: Finding, cost: Cost | None, to_do: str = "") -> Paragraph:
    """A finding; without a ``cost`` nothing is said of the path but for a camera's. ``to_do`` where
    that is not what mostly is to be done about the effect."""
    known = CATALOGUE.get(finding.effect)
    parts = [f"({finding.effect}.)", how_sure(finding.evidence_nats, finding.p_value)]
    if finding.confusable_with:
        others = [in_a_word(name) for name in finding.confusable_with]
        shown = [*others[:FEW], f"{len(others) - FEW} more"] if len(others) > FEW else others
        parts.append(
            "What is not sure is that it is this and nothing else: these data cannot tell it from "
            f"{listed(shown)}."
        )
    if finding.drift is not None:
        parts.append(drift_words(finding.drift))
    elif finding.resembles:
        parts.append(f"Nor is it sure that its form is right: it may be {finding.resembles}.")
    parts += same_words(finding.same_as)
    if cost is not None:
        parts.append(cost_words(cost, noise=known is not None and _is_noise(known)))
    elif known is not None and known.family == "camera":
        parts.append("What it costs: it moves the signs, not the path.")
    parts.append(f"What to do: {as_clause(to_do or remedy(finding.effect))}")
    if finding.advice:
        parts.append(f"To tell which it is: {finding.advice}.")
    return what_is_wrong(finding), " ".join(parts)


def same_words(same_as: str) -> list[str]:
    """What makes the same of all data elsewhere, and what then is sure."""
    if not same_as:
        return []
    return [
        f"To these data {same_as} would be the same: that the two differ is what is sure, and "
        "which of them errs only something else that is known can tell."
    ]


def drift_words(drift: Drift) -> str:
    """That a value is no constant, and how it changes."""
    factor, unit = (math.degrees(1.0), "°") if drift.unit == "rad" else (1.0, drift.unit)
    size, sd = with_sd(factor * drift.change, factor * drift.sd, unit)
    what = drift.parameter.replace("_", " ")
    way = "falls" if drift.change < 0.0 else "grows"
    change = f"its {what} {way} by {size} (give or take {sd}) {drift.when}"
    if not drift.sure:
        return f"It may be no constant: that {change} is likelier than that it stays."
    return f"It is not constant: {change}, so the number told is right in the mean alone."


def _without(effect: str, instead: Sequence[str]) -> str:
    """What is to be done about a finding that the written model leaves to a run's own effects."""
    names = listed([in_a_word(name) for name in instead])
    left = f"model.toml is without it: a run estimates {names} on every drive anyhow."
    return f"{remedy(effect).replace(MODEL, '').replace(TAKE_MODEL, '').strip()} {left}".strip()


def _is_noise(effect: Effect) -> bool:
    """Whether the model without it has other noise, and all effects."""
    return effect.family == "noise" or effect.nuisance


def formula_words(one: Unexplained, cost: Cost | None) -> Paragraph:
    """Something that no effect of the library explains."""
    lead = f"Something acts on {channel_words(one.channel)} that no known effect explains."
    parts = [
        f"What fits best is {one.formula}, with {one.numbers}.",
        how_sure(one.evidence_nats, one.p_value),
    ]
    if one.resembles:
        parts.append(f"Of the known effects {in_a_word(one.resembles)} is most like it.")
    if one.confusable_with:
        others = listed(list(one.confusable_with))
        parts.append(f"These drives do not tell it from {others}.")
    parts += same_words(one.same_as)
    if cost is not None:
        parts.append(cost_words(cost))
    parts.append(
        "What to do: look for a cause that goes with the quantities of the formula. Until it is "
        "found take model.toml, which has the formula."
    )
    return lead, " ".join(parts)


def noise_words(claim: NoiseClaim, cost: Cost | None) -> Paragraph:
    """A level of noise that is not as stated."""
    what = LEVELS.get(claim.level, sentence_case(claim.level.replace("_", " ")))
    parts = [how_sure(claim.evidence_nats, claim.p_value)]
    if cost is not None:
        parts.append(cost_words(cost, noise=True))
    if claim.cause:
        parts.append(
            f"What makes it: {claim.cause}. What to do: have the sensor told as finely as it "
            "measures, by its range and by what writes its log. Until then take model.toml."
        )
    else:
        parts.append(
            "What to do: take model.toml, which has the noise as it is. What makes it, nothing "
            "here says: look for what shakes the sensor or shades the antenna."
        )
    lead = f"{what} is {claim.factor:.2g} times as large as stated"
    if claim.condition:
        lead += f" {claim.condition}, {claim.elsewhere:.2g} times elsewhere"
    return f"{lead}.", " ".join(parts)


def kept_out_words(one: KeptOut) -> Paragraph:
    """An effect that held-out data spoke against."""
    why = (
        "with it the held-out positions are predicted worse than without. No model may make "
        "positions worse"
        if one.positions
        else "the held-out data are less likely with it"
    )
    if one.each_drive:
        return (
            f"Not the same on every drive: {in_a_word(one.effect)}.",
            f"The fitted data speak for it, but {why} at the same value. Receivers smooth by how "
            "they are driven and what they see, so model.toml has it without a value: every drive "
            "is fitted with its own. Nothing is to be done.",
        )
    return (
        f"Not taken: {in_a_word(one.effect)}.",
        f"The fitted data speak for it, but {why}, so it is not in model.toml. What to do: "
        "give another drive with --holdout, which would show whether it holds.",
    )


def how_sure(nats: float, p_value: float) -> str:
    """Odds and p-value as a sentence."""
    said = [text for least, most, text in SURE if nats >= least and p_value <= most]
    words = said[0] if said else "possible, but not sure"
    return (
        f"How sure: {words}. The data are {_times(nats)} likelier with it, and {_chance(p_value)}."
    )


def _times(nats: float) -> str:
    if nats >= math.log(MILLION):
        return "more than a million times"
    if nats < math.log(2.0):
        return "hardly"
    return f"about {_round(math.exp(nats))} times"


def _chance(p: float) -> str:
    if p < 1.0 / MILLION:
        return "chance alone shows as much in less than one search of a million"
    if p >= 0.1:
        return "chance alone often shows as much"
    return f"chance alone shows as much in about one search of {_round(1.0 / p)}"


def _round(number: float) -> str:
    """A number to one digit, thousands apart."""
    power = 10 ** math.floor(math.log10(number))
    return f"{round(number / power) * power:,.0f}".replace(",", " ")


def cost_words(cost: Cost, noise: bool = False) -> str:
    """How far the path is off where the effect is left out."""
    degrees = [math.degrees(v) for v in (cost.heading.rms, cost.tilt.rms)]
    what = "With the noise as stated" if noise else "Without it"
    if max(cost.level.largest, cost.height.largest) < LEAST_M and max(degrees) < LEAST_DEG:
        return f"What it costs: nothing here. {what} the held-out path is the same."
    sizes = [
        _off(cost.level.rms, cost.level.largest, "m", LEAST_M, "level"),
        _off(cost.height.rms, cost.height.largest, "m", LEAST_M, "in height"),
        _off(degrees[0], math.degrees(cost.heading.largest), "°", LEAST_DEG, "in heading"),
        _off(degrees[1], math.degrees(cost.tilt.largest), "°", LEAST_DEG, "in tilt"),
    ]
    return (
        f"What it costs: {what[:1].lower()}{what[1:]} the held-out path is off by {listed(sizes)}."
    )


def _off(rms: float, largest: float, unit: str, least: float, where: str) -> str:
    if largest < least:
        return f"nothing {where}"
    return f"{about(rms, unit, least)} {where} (at most {about(largest, unit, least)})"


def channel_words(channel: str) -> str:
    """A channel of a formula as a person calls it."""
    sensor, _, axis = channel.partition("_")
    name = {"x": "forward", "y": "right", "z": "down"}.get(axis)
    sensors = {"gyro": "gyro", "accel": "accelerometer"}
    if name and sensor in sensors:
        return f"the {sensors[sensor]}'s {name} axis"
    if sensor == "imu":
        return "the IMU's clock" if axis == "time" else f"the {axis} of the IMU's mounting"
    return f"the receiver's or the vehicle's {channel.replace('_', ' ')}"


def position_words(positions: HeldPositions | None, found: bool = True) -> str:
    """How well held-out positions are predicted, before and after where anything was found."""
    if positions is None:
        return ""
    (level_then, level), (height_then, height) = (
        [about(size, "m", LEAST_M) for size in sizes]
        for sizes in (positions.level, positions.height)
    )
    text = (
        "From all that came before, each held-out fix is predicted to "
        f"{level} level and {height} in height (rms)"
    )
    if not found:
        return f"{text}."
    if (level_then, height_then) == (level, height):
        return f"{text}, under the same noise as well without as with what was found."
    text += (
        f"; without what was found, under the same noise, to {level_then} level and {height_then} "
        "in height."
    )
    sides = ((positions.level, level_then != level), (positions.height, height_then != height))
    if any(seen and after > before for (before, after), seen in sides):
        text += " What got worse did so by no more than chance makes likely."
    return text


def _overview(result: GapResult) -> Paragraph:
    found = len(result.findings) + len(result.formulas)
    left = bool(result.misfits)
    if found:
        number = NUMBERS[found] if found < len(NUMBERS) else str(found)
        lead = f"{number} thing{' is' if found == 1 else 's are'} missing from the model."
    elif left or result.noise_claims:
        lead = "No known effect is missing that these data can show, but not all is as modelled."
    elif any(not one.each_drive for one in result.kept_out):
        lead = "Nothing that held-out data bear out is missing from the model."
    else:
        lead = "Nothing is missing from the model as far as these data can show."
    parts = [position_words(result.positions, found > 0)]
    if found:
        parts.append(
            "Give or take is one standard deviation. Costs are by how much (rms) the held-out "
            "path is off that of the new model."
        )
    else:
        parts += [_suspicion(result), "Nothing to mend: model.toml is the model of the run."]
        if left or result.noise_claims:
            parts[-1] = "What is off is told below."
    if not left:
        parts.append("What the new model leaves is as small and as random as it should be.")
    return lead, " ".join(p for p in parts if p)


def _suspicion(result: GapResult) -> str:
    if not result.refused:
        return ""
    one = result.refused[0]
    return f"The strongest suspicion is {in_a_word(one.effect)}, which is too weak to be named."
