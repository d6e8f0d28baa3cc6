"""One figure then and now."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Group = Literal["run", "trajectory", "signs", "sync", "calibration", "timing", "truth"]


@dataclass(frozen=True)
class Tolerance:
    """What may move without being told.

    ``mean`` of a figure over a whole drive, ``worst`` at a single epoch or sign, both in stated
    sigmas; ``count`` in standard deviations of a Poisson count; ``spread`` the factor on a
    stated sigma; ``slower`` the factor on processor time; ``sure`` the confidence from which a
    sign that comes or goes matters, and ``confidence`` by how much a confidence may change.
    """

    mean: float = 0.1
    worst: float = 0.3
    count: float = 0.5
    spread: float = 1.1
    slower: float = 2.0
    sure: float = 0.5
    confidence: float = 0.1

    def scaled(self, mean: float) -> Tolerance:
        """The same with another ``mean`` and a ``worst`` in proportion."""
        return Tolerance(mean=mean, worst=self.worst / self.mean * mean)


@dataclass(frozen=True)
class Change:
    """A figure then and now.

    ``sigmas`` is by how many stated sigmas it moved and ``allowed`` how many are tolerated;
    where sigmas make no sense (a class, a time) they are None and ``size`` says it in words.
    ``moved`` is the verdict; ``information`` marks what is told and never judged.
    """

    group: Group
    name: str
    then: str
    now: str
    moved: bool
    sigmas: float | None = None
    allowed: float | None = None
    size: str = ""
    information: bool = False

    @property
    def extent(self) -> str:
        """By how much it moved, for a table."""
        if self.sigmas is None:
            return self.size
        shown = f"{self.sigmas:.2f} σ" if self.sigmas < 100.0 else f"{self.sigmas:.0f} σ"
        return f"{shown}{', ' + self.size if self.size else ''}"

    @property
    def limit(self) -> str:
        """What is allowed, for a table."""
        return "" if self.allowed is None else f"{self.allowed:g} σ"
