"""What an effect is: its parameters, the terms by which it acts, and what follows from these."""

from __future__ import annotations

import math
from dataclasses import dataclass

from automap.effects.terms import (
    INERTIAL,
    POSITION_ACCURACY,
    VEHICLE,
    VELOCITY,
    GaussMarkov,
    Kind,
    Term,
)


@dataclass(frozen=True)
class Parameter:
    """One number of an effect: its name within the effect, unit, prior one-sigma and range."""

    name: str
    unit: str
    prior_sd: float
    at_least: float = -math.inf
    at_most: float = math.inf


@dataclass(frozen=True)
class Effect:
    """A named physical effect.

    ``family`` is where it acts: "imu", "noise", "clock", "gnss", "vehicle", "earth", "camera".
    ``terms`` say how each parameter acts; noise, and what the camera's own model holds, has none.
    ``markov`` makes them errors that come and go. ``setting`` is the option of the fusion that
    says how large it is where it is no state, ``walk_setting`` that of its random walk. A
    ``nuisance`` is part of every model, never a finding. ``first_order`` names the effect that
    acts alike to first order, and with which sign; ``unknown_epoch`` the one that acts as this
    does at an instant that nobody knows. What is ``one_signed`` has no values below zero in
    nature, what is ``isotropic`` much the same on all axes. ``looks_like`` is what it shows as,
    with others, where a drive shows little; ``told_apart`` which manoeuvre tells it from another
    effect: (its name, the manoeuvre).
    """

    name: str
    family: str
    parameters: tuple[Parameter, ...]
    summary: str
    terms: tuple[Term, ...] = ()
    markov: GaussMarkov | None = None
    setting: str = ""
    walk_setting: str = ""
    nuisance: bool = False
    first_order: tuple[str, float] | None = None
    unknown_epoch: str = ""
    one_signed: bool = False
    isotropic: bool = False
    looks_like: str = ""
    told_apart: tuple[tuple[str, str], ...] = ()

    def acts_on(self, *measured: str) -> bool:
        """Whether a term acts on one of these."""
        return any(t.on in measured for t in self.terms)

    def follows(self, signal: str) -> bool:
        """Whether a term is multiplied by that signal."""
        return any(t.signal == signal for t in self.terms)

    def terms_of(self, parameter: str) -> tuple[Term, ...]:
        """The terms of one parameter."""
        return tuple(t for t in self.terms if t.parameter == parameter)

    @property
    def follows_accuracy(self) -> bool:
        """Whether its size is a share of the accuracy that each fix states."""
        return any(t.signal in POSITION_ACCURACY for t in self.terms)

    @property
    def needs_wheels(self) -> bool:
        """Whether it shows in what wheels report and nowhere else."""
        return bool(self.terms) and all(
            t.on == VEHICLE and t.axis == 0 and t.kind in (Kind.AXIS, Kind.SCALE, Kind.TIME)
            for t in self.terms
        )

    @property
    def states(self) -> tuple[str, ...]:
        """What the filter estimates of it, in order: its parameters, or its correlated errors."""
        if self.markov is None:
            return tuple(p.name for p in self.parameters)
        return tuple(dict.fromkeys(t.parameter for t in self.terms))

    @property
    def sensor(self) -> str:
        """The inertial sensor that it acts on alone, nothing for all others."""
        measured = {t.on for t in self.terms}
        return measured.pop() if len(measured) == 1 and measured <= set(INERTIAL) else ""

    @property
    def of_recorder(self) -> bool:
        """Whether what is recorded has it, not the vehicle's path: of sensors, receiver, wheels."""
        recorded = self.family in ("imu", "gnss") and bool(self.terms) and self.markov is None
        return recorded or self.needs_wheels

    @property
    def never_negative(self) -> bool:
        """Whether a value below zero makes no physical sense."""
        return self.one_signed or (
            bool(self.parameters) and all(p.at_least == 0.0 for p in self.parameters)
        )

    @property
    def resembles(self) -> str:
        """What a noisy screening takes it for, with all others of that kind; nothing for most."""
        if any(t.kind in (Kind.TIME, Kind.LAG, Kind.COURSE) for t in self.terms):
            return "a delay"
        return self.looks_like

    @property
    def resembles_drift(self) -> bool:
        """Whether a random walk of a bias can stand in for it: what adds to readings, or tilts."""
        tilts = any(t.kind == Kind.TURN for t in self.terms)
        return not self.nuisance and (tilts or self.acts_on(*INERTIAL))

    @property
    def resembles_velocity_wander(self) -> bool:
        """Whether a part of it may be taken for velocity errors that last: they do in a bend."""
        kinds = (Kind.TIME, Kind.LAG, Kind.COURSE, Kind.POINT)
        return any(t.on == VELOCITY and t.kind in kinds for t in self.terms)
