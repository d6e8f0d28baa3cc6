"""The head of the page: whether the path may be relied on, and why not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pipeline.pages.section import Section
from pipeline.report.figures import duration_text
from pipeline.shared.values import mapping

_WORDS = {
    "good": "The path agrees with all that was measured, as far as can be told.",
    "doubtful": "The path contradicts some of what was measured. Its uncertainty was widened to "
    "what was seen, and that of the signs with it.",
    "unusable": "The path is of no use for a map.",
}


def verdict_section(record: dict[str, Any]) -> tuple[str, Section]:
    """The state for the heading, "" without one, and its reasons; ``record`` is run.json."""
    verdict = mapping(record.get("verdict"))
    state = str(verdict.get("state", ""))
    section = Section()
    if state not in _WORDS:
        return "", section
    section.sentences.append(_WORDS[state])
    reasons = verdict.get("reasons")
    for reason in reasons if isinstance(reasons, list) else ():
        text = str(mapping(reason).get("text", ""))
        told = f"{text[:1].upper()}{text[1:]}{_where(reason)}."
        section.verdicts.append(("good" if state == "good" else "bad", told))
    return state, section


def _where(reason: dict[str, Any]) -> str:
    """The stretches of the drive that a reason is about, in words."""
    spans = reason.get("spans_s")
    told = [_span_text(span) for span in spans] if isinstance(spans, list) else []
    if not told:
        return ""
    more = f" and {len(told) - _SHOWN} more" if len(told) > _SHOWN else ""
    return f" ({', '.join(told[:_SHOWN])}{more} into the drive)"


_SHOWN = 5
"""Stretches told of one reason; run.json has them all."""


def _span_text(span: Sequence[float]) -> str:
    return f"{duration_text(span[0])} to {duration_text(span[1])}"
