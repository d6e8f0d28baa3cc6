"""A reason to doubt a path, in words for people and in numbers for the sigmas."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

State = Literal["good", "doubtful", "unusable"]
STATES: tuple[State, ...] = ("good", "doubtful", "unusable")
"""From the best to the worst."""

Span = tuple[float, float]
"""From and to, in s from the first row of the trajectory."""


@dataclass(frozen=True)
class Reason:
    """What contradicts the path: ``code`` for programs, ``text`` one sentence with its figure and
    what to do.

    ``spans`` the stretches it is about, none for the whole drive; ``error_m`` the error of
    position that shows there, horizontally, ``span_errors_m`` what the path is off by in each of
    them at most, where that is known, and ``span_heights_m`` its height; ``height_m`` the error of
    the height, ``late_s`` by how much the whole state may be of another instant, ``moved_s`` the
    same of velocity and attitude where the positions are of theirs; ``heading`` rad that headings
    are off; ``factor`` by how much the sigmas are too small.
    ``state`` what it alone makes of the path; ``inertial`` that it speaks against the IMU, ``led``
    that an IMU leads over the stretches, in which positions are no witness,
    ``handled`` that what is wrong was left out and the sigmas hold without it.
    """

    code: str
    text: str
    spans: tuple[Span, ...] = ()
    error_m: float = 0.0
    factor: float = 1.0
    height_m: float = 0.0
    late_s: float = 0.0
    moved_s: float = 0.0
    heading: float = 0.0
    state: State = "doubtful"
    inertial: bool = False
    led: bool = False
    handled: bool = False
    span_errors_m: tuple[float, ...] = ()
    span_heights_m: tuple[float, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """For run.json."""
        out: dict[str, Any] = {"code": self.code, "text": self.text}
        if self.spans:
            out["spans_s"] = [[round(t, 1) for t in span] for span in self.spans]
        return out


@dataclass(frozen=True)
class Verdict:
    """Whether a path may be relied on, and why not."""

    state: State
    reasons: tuple[Reason, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """For run.json."""
        return {"state": self.state, "reasons": [reason.as_dict() for reason in self.reasons]}


def verdict_of(reasons: Iterable[Reason]) -> Verdict:
    """The verdict that ``reasons`` make: the worst of them counts, and is told first."""
    told = sorted(reasons, key=lambda reason: -STATES.index(reason.state))
    return Verdict(told[0].state if told else "good", tuple(told))
