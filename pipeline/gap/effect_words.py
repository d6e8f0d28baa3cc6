"""A finding as a plain sentence: what is wrong, by how much, which way."""

from __future__ import annotations

import math
from collections.abc import Sequence

from automap.effects import CATALOGUE
from automap.gap.result import Finding, ParameterValue
from pipeline.gap.effect_sentences import SENTENCES
from pipeline.gap.sentence_parts import Part
from pipeline.gap.sizes import with_sd

SHOWS = 3.0
"""Sigmas from which on a parameter is told of: of an arm's three axes two mostly do nothing, and a
person would measure them again for nothing. The strongest is told of anyhow."""

FEW = 3
"""So many parameters are told of, the surest; the table has all."""


def what_is_wrong(finding: Finding) -> str:
    """A finding as a sentence; of what is not in the table (an effect of the user's) the summary
    and the numbers."""
    sentence = SENTENCES.get(finding.effect)
    if sentence is None:
        return _summary(finding)
    parts = {p: v for p, v in finding.parameters.items() if p in sentence.parts}
    if not parts:
        return _summary(finding) if finding.parameters else sentence.frame
    sure = {p: abs(v.value) / max(v.sd, 1e-300) for p, v in parts.items()}
    shown = [p for p in parts if sure[p] >= SHOWS] or [max(parts, key=lambda p: sure[p])]
    told = sorted(shown, key=lambda p: -sure[p])[:FEW]
    words = [_part(sentence.parts[p], parts[p]) for p in shown if p in told]
    if len(shown) == 1:
        text, unsure = words[0]
        return f"{sentence.frame.format(text).removesuffix('.')}{unsure}."
    rest = [f"{len(shown) - FEW} more"] if len(shown) > FEW else []
    return sentence.frame.format(listed([text + unsure for text, unsure in words] + rest))


def in_a_word(name: str) -> str:
    """A name with what it is, for a list."""
    return f"{name} ({CATALOGUE[name].summary})" if name in CATALOGUE else name


def listed(words: Sequence[str]) -> str:
    """Words with commas and an "and"."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} and {words[-1]}"


def sentence_case(text: str) -> str:
    """The text with a large first letter."""
    return text[:1].upper() + text[1:]


def as_clause(text: str) -> str:
    """The text with a small first letter, for after a colon."""
    return text[:1].lower() + text[1:]


def _part(part: Part, value: ParameterValue) -> tuple[str, str]:
    """A parameter in words, and what is unsure of it."""
    size, unsure = _size(part.factor * value.value, part.factor * value.sd, part.unit)
    return (part.more if value.value >= 0.0 else part.less).format(size), unsure


def _size(value: float, sd: float, unit: str) -> tuple[str, str]:
    """A size as text, and what is unsure of it."""
    size, unsure = with_sd(value, sd, unit)
    if math.isinf(sd):
        return f"at least {size}", ""
    return size, f" (give or take {unsure})" if sd > 0.0 else ""


def _summary(finding: Finding) -> str:
    known = CATALOGUE.get(finding.effect)
    numbers = []
    for name, v in finding.parameters.items():
        size, unsure = _size(v.value, v.sd, v.unit)
        numbers.append(f"{name} is {'-' if v.value < 0.0 else ''}{size}{unsure}")
    text = sentence_case(known.summary if known else finding.effect)
    return f"{text}: {listed(numbers)}." if numbers else f"{text}."
