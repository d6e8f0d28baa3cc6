"""A search that notes what it is asked to fit, and fits nothing."""

from __future__ import annotations

from collections import Counter
from types import SimpleNamespace
from typing import Any, cast

from automap.fusion.levels import ALL_LEVELS
from automap.gap.bias_drift import BiasDrift
from automap.gap.judge import Judge
from automap.gap.reforming import Forms
from automap.gap.search import Search
from automap.gap.selection import Chosen, Selection

LATE, LOW_PASSED = "gnss_velocity_latency", "gnss_velocity_lag"


SELECTION = cast(
    "Selection",
    SimpleNamespace(
        candidates={
            name: SimpleNamespace(parts=((i,),)) for i, name in enumerate((LATE, LOW_PASSED))
        },
        log_prior=lambda chosen: 0.0,
        of_vehicle=lambda chosen, names: False,
        sensors=lambda chosen, name: frozenset(),
        keys=lambda chosen: frozenset((name, part) for name, part, _ in chosen.parts),
    ),
)
HERE: Any = SimpleNamespace(fits=(), model=SimpleNamespace(factors=dict.fromkeys(ALL_LEVELS, 1.0)))


class Heard(Judge):
    """A judge of drives that nobody fits."""

    def _held_out(self, fitted: Any) -> Any:
        return []


class Asked(Search):
    """A search that notes which sets it is asked to fit."""

    def __init__(self) -> None:
        self.log, self.outdone, self.borne_out = print, set(), {}
        self.compared = Counter()
        self.judge, self.tried = Heard(cast("Any", ["a drive"])), {}
        self.screening = cast("Any", None)
        self.sets: list[tuple[str, ...]] = []
        self.drift = BiasDrift(self.screening, self.judge, self.borne_out, print)
        self.forms = Forms(self.screening, self.judge, self.drift.without, {})

    def _fit(self, here: Any, selection: Selection, chosen: Chosen) -> Any:
        self.sets.append(chosen.names)
        return SimpleNamespace(fits=())


def only(name: str) -> Chosen:
    """A choice of one."""
    return Chosen(((name, (0,), 1.0),))


def fit_of(name: str) -> Any:
    """What stands for the fit of a set."""
    return SimpleNamespace(name=name, joint=lambda: None, fits=())
