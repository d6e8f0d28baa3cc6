"""Which of several runs of one recording counts in a map, and why."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from automap.errors import InputError
from automap.io import names
from pipeline.merge.doubles import Marks, doubles, sentence
from pipeline.shared.values import listing, mapping

_VERDICTS = ("good", "", "doubtful", "unusable")
"""The better first; of a run that has none nothing bad is known."""


@dataclass(frozen=True)
class Candidate:
    """What is known of a run: its ``name`` for people, the ``key`` of its recording ("" unknown),
    its ``marks``, its ``verdict`` ("" none) with its first ``reason``, the ``decisions`` of its
    review, and when the last one was made (``reviewed_s``, of the Unix epoch)."""

    name: str
    key: str
    marks: Marks | None
    verdict: str
    reason: str
    decisions: int
    reviewed_s: float


def candidate(
    name: str, key: str, marks: Marks | None, verdict: Any, folder: Path | None
) -> Candidate:
    """A run by its ``verdict`` as run.json has it and the review in ``folder``."""
    decisions, reviewed_s = (0, 0.0) if folder is None else _reviewed(folder / names.REVIEW)
    told = mapping(verdict)
    reasons = [str(mapping(r).get("text", "")) for r in listing(told.get("reasons"))]
    return Candidate(
        name, key, marks, str(told.get("state") or ""), "".join(reasons[:1]), decisions, reviewed_s
    )


def _reviewed(path: Path) -> tuple[int, float]:
    """How many signs a review decides on, and when it last did."""
    if not path.is_file():
        return 0, 0.0
    from automap.io.review_json import read_review
    from automap.review.verdicts import standing, verdicts

    try:
        actions = read_review(path)
    except InputError:
        # who reads the signs says so
        return 0, 0.0
    times = [datetime.fromisoformat(action.time) for action in standing(actions)]
    last = max((t if t.tzinfo else t.replace(tzinfo=UTC) for t in times), default=None)
    return len(verdicts(actions)), 0.0 if last is None else last.timestamp()


_RANKS: tuple[tuple[Callable[[Candidate], float], str], ...] = (
    (lambda run: -bool(run.decisions), "that which is reviewed"),
    (lambda run: -run.reviewed_s if run.decisions else 0.0, "that which was reviewed last"),
    (lambda run: _rank(run.verdict), "that with the better verdict ({kept}, not {left})"),
    (lambda run: -len(run.marks.count) if run.marks is not None else 0, "the longer one"),
)
"""What speaks for a run, the first that differs decides: work of people, which a merge cannot make
again, before the path, and the path before a few seconds more."""


def _rank(verdict: str) -> int:
    return _VERDICTS.index(verdict) if verdict in _VERDICTS else _VERDICTS.index("doubtful")


def distinct(runs: Sequence[Candidate], another: str) -> tuple[list[int], list[str]]:
    """Places of the runs that count, in their order, and sentences about the others, which are
    ``another`` run of the same or parts of one; of equals the first counts."""
    order = sorted(range(len(runs)), key=lambda k: [rank(runs[k]) for rank, _ in _RANKS])
    warnings: list[str] = []
    by_key: dict[str, Candidate] = {}
    single: list[int] = []
    for k in order:
        run = runs[k]
        if run.key and run.key in by_key:
            warnings.append(_left_out(run, by_key[run.key], another))
        else:
            by_key[run.key] = run
            single.append(k)
    parts = set()
    for pair in doubles([runs[k].marks for k in single]):
        part, whole = single[pair.part], single[pair.whole]
        if pair.left_out:
            parts.add(part)
            how = another if pair.alike else ""
            warnings.append(_left_out(runs[part], runs[whole], how))
        else:
            warnings.append(sentence(pair, runs[part].name, runs[whole].name))
    return sorted(set(single) - parts), warnings


def _left_out(left: Candidate, kept: Candidate, another: str) -> str:
    """Why one counts and not the other, and what is lost by it; without ``another`` the one is a
    part of the other."""
    if another:
        why = next((text for rank, text in _RANKS if rank(left) != rank(kept)), "the first by name")
        why = why.format(kept=kept.verdict or "none", left=left.verdict or "none")
        told = f"left out: {left.name} is {another} {kept.name}; one recording counts once, {why}."
    else:
        told = (
            f"left out: {left.name} is part of the recording of {kept.name}; one recording counts "
            "once, the whole."
        )
    if not left.decisions:
        return told
    signs = "one sign" if left.decisions == 1 else f"{left.decisions} signs"
    lost = f"the decisions on {signs} of the one left out are not in the map"
    if kept.decisions:
        return f"{told} Both are reviewed: {lost}; make them in the other."
    return f"{told} It is reviewed: {lost}; a copy of its {names.REVIEW} beside the other has them."


def doubted(runs: Sequence[Candidate]) -> list[Candidate]:
    """Those whose path is doubtful or unusable."""
    return [run for run in runs if run.verdict not in ("", "good")]
