"""The head of the page: whether path and signs may be relied on, and why not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from pipeline.pages.section import Section
from pipeline.report.figures import duration_text
from pipeline.shared.values import listing, mapping
from pipeline.shared.verdicts import KEYS, verdicts

_WORDS = {
    ("path", "good"): "The path agrees with all that was measured, as far as can be told.",
    ("path", "doubtful"): "The path contradicts some of what was measured. Its uncertainty was "
    "widened to what was seen, and that of the signs with it.",
    ("path", "unusable"): "The path is of no use for a map.",
    ("signs", "good"): "",
    ("signs", "doubtful"): "The signs are not to be put into a register as they are.",
}


def verdict_section(record: dict[str, Any]) -> tuple[str, Section]:
    """The heading, such as "path good, signs doubtful", "" without a verdict, and the reasons;
    ``record`` is run.json."""
    section = Section()
    heading = []
    for key in KEYS:
        told = verdicts(record).get(key)
        words = None if told is None else _WORDS.get((key, told.state))
        if told is None or words is None:
            continue
        heading.append(f"{key} {told.state}")
        section.sentences += [words] if words else []
        for reason in listing(mapping(record[KEYS[key]]).get("reasons")):
            text = str(mapping(reason).get("text", ""))
            line = f"{text[:1].upper()}{text[1:]}{_where(mapping(reason))}."
            section.verdicts.append(("good" if told.state == "good" else "bad", line))
    return ", ".join(heading), section


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
