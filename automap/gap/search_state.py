"""Where a search for missing effects stands, and fits of all its drives."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from automap.effects.catalogue import bias_walks
from automap.gap.drive import OpenDrive
from automap.gap.fit import Fit, fit_drive
from automap.gap.formula import Formula
from automap.gap.model import GapModel, parameter_names, prior_sd
from automap.gap.noise import Curvatures
from automap.gap.scoring import Joint, combine
from automap.gap.screening import Candidate
from automap.records import FloatArray

MIN_NATS = 7.0
MAX_P = 1e-3
"""An effect needs this much evidence, and this little chance, to be named."""
LOW_WALK = 0.1
WALKS = tuple(bias_walks())
Log = Callable[[str], None]
Stage = tuple[GapModel, Mapping[str, Mapping[str, float]]]


@dataclass(frozen=True)
class Trial:
    """A candidate that was fitted: joint estimate of all estimated effects, evidence in nats,
    p-value, the model it was fitted under, the null's largest evidences;
    ``noise_refitted`` where all levels of that model were fitted with it; ``stage`` counts the
    accepted ones from 1."""

    candidate: Candidate
    joint: Joint
    fits: tuple[Fit, ...]
    model: GapModel
    nats: float
    p_value: float
    maxima: FloatArray
    noise_refitted: bool = False
    stage: int = 0

    @property
    def effect(self) -> str:
        """Name of the effect."""
        return self.candidate.effect

    @property
    def scale(self) -> float:
        """Factor on its prior sd."""
        return self.candidate.evidence.scale

    @property
    def screened(self) -> float:
        """Evidence of the screening in nats."""
        return self.candidate.evidence.nats


@dataclass
class State:
    """Where a search stands: fits of the drives under ``model`` with the accepted effects,
    ``stated_factors`` on the noise levels of the model as it was given, ``refused`` effects that
    held-out data did not confirm under the present model, with a sentence on each;
    ``confusable`` what each name cannot be told from; ``runner_up`` the best name where a formula
    beat it, ``equivalent_formula`` one that did as well as the best name;
    ``formulas`` whether any are tried; ``stages`` models and effects' values, the base model's
    first, then after each name; ``held_fits`` the newest ones of the held-out drives,
    ``curvatures`` what is known of the noise's likelihood."""

    drives: list[OpenDrive]
    held_out: list[OpenDrive]
    stated_factors: Mapping[str, float]
    model: GapModel
    fits: list[Fit]
    held_fits: list[Fit] = field(default_factory=list)
    curvatures: Curvatures = field(default_factory=dict)
    accepted: dict[str, float] = field(default_factory=dict)
    trials: list[Trial] = field(default_factory=list)
    confusable: dict[str, tuple[str, ...]] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)
    exclude: frozenset[str] = frozenset()
    restarts: int = 0
    warnings: list[str] = field(default_factory=list)
    unexplained: Formula | None = None
    resembles: str | None = None
    equivalent_formula: str | None = None
    runner_up: Trial | None = None
    formulas: bool = True
    stages: list[Stage] = field(default_factory=list)


def fit_all(state: State, model: GapModel, estimate: Mapping[str, float]) -> list[Fit]:
    """All drives under a model with effects as states."""
    return [
        fit_drive(d, model, estimate, linearised_at=f)
        for d, f in zip(state.drives, state.fits, strict=True)
    ]


def prior_of(model: GapModel, estimate: Mapping[str, float]) -> FloatArray:
    """Prior sds [p] of the estimated effects' parameters in order."""
    return np.array(
        [
            scale * prior_sd(model.options, effect, parameter)
            for effect, scale in estimate.items()
            for parameter in parameter_names(effect)
        ]
    )


def joint_of(
    model: GapModel, estimate: Mapping[str, float], fits: Sequence[Fit], gains: Sequence[float]
) -> Joint:
    """The drives' estimates as one."""
    return combine(fits, gains, prior_of(model, estimate))


def values_of(joint: Joint, effects: Collection[str]) -> dict[str, dict[str, float]]:
    """Effect -> parameter -> value out of a joint estimate."""
    return {e: {p: v for p, (v, _) in joint.of(e).items()} for e in effects}


def estimated(state: State) -> dict[str, dict[str, float]]:
    """Values of the accepted effects by the state's fits."""
    if not state.fits:
        return {}
    joint = joint_of(state.model, state.accepted, state.fits, [0.0] * len(state.fits))
    return values_of(joint, state.accepted)
