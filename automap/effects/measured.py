"""Terms on fixes and on the vehicle's motion: as the kernels' table, and exactly, for a simulator.

Values map effect to parameter to value, in the catalogue's names and units; what is not given is
zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.effects.catalogue import CATALOGUE
from automap.effects.term_sums import MeasuredTerms, Terms
from automap.effects.terms import (
    FORWARD_ACCELERATION,
    LATERAL_ACCELERATION,
    ONE,
    POSITION,
    STATE_SIGNALS,
    VEHICLE,
    VELOCITY,
    Kind,
    Term,
)
from automap.records import FloatArray

Values = Mapping[str, Mapping[str, float]]
MEASURED = (POSITION, VELOCITY, VEHICLE)


def measured_terms(places: Mapping[str, int]) -> tuple[MeasuredTerms, tuple[str, ...]]:
    """The terms of effects whose first state is that parameter of the filter (``places``), and the
    names of the signals whose columns they need."""
    rows: dict[str, list[tuple[int, int, int, int, float]]] = {on: [] for on in MEASURED}
    signals: list[str] = []
    for name, first in places.items():
        states = CATALOGUE[name].states
        for term in CATALOGUE[name].terms:
            if term.on not in MEASURED:
                continue
            code = _signal_code(term, signals)
            # to first order a low-pass is a delay by its time constant
            kind, sign = (Kind.TIME, -1.0) if term.kind == Kind.LAG else (term.kind, 1.0)
            place = first + states.index(term.parameter)
            rows[term.on].append((place, int(kind), term.axis, code, sign * term.weight))
    each = [
        Terms(
            np.array([row[:4] for row in rows[on]], dtype=np.int64).reshape(-1, 4),
            np.array([row[4] for row in rows[on]], dtype=np.float64),
        )
        for on in MEASURED
    ]
    return MeasuredTerms(*each), tuple(signals)


def _signal_code(term: Term, signals: list[str]) -> int:
    if term.signal not in STATE_SIGNALS:
        if term.signal not in signals:
            signals.append(term.signal)
        return len(STATE_SIGNALS) + signals.index(term.signal)
    if term.signal in (FORWARD_ACCELERATION, LATERAL_ACCELERATION):
        assert term.on == VEHICLE, "accelerations along the vehicle are known for its velocity only"
    return STATE_SIGNALS.index(term.signal)


@dataclass(frozen=True)
class Distortion:
    """What terms on one measurement add up to at ``n`` instants: ``arm`` [3] m, of a point that
    moves [n, 3], and ``turn`` [n, 3] rad in vehicle axes, ``late`` [n] s, ``course_late`` [n] s of
    the direction beyond that, ``lag`` s of a low-pass, ``added`` [n, 3] in the measurement's axes,
    ``slip`` [n, 3] rad, ``longer`` [3] factors on the components."""

    arm: FloatArray
    turn: FloatArray
    late: FloatArray
    course_late: FloatArray
    lag: float
    added: FloatArray
    slip: FloatArray
    longer: FloatArray


def distortion(
    values: Values,
    on: str,
    n: int,
    signal: Callable[[str], FloatArray],
    families: Sequence[str] = ("gnss", "vehicle"),
) -> Distortion:
    """The terms of effects of known size on one measurement; ``signal`` gives [n] by name.

    Errors of clocks are left out by default: a simulator puts them into the stamps.
    """
    out = Distortion(
        np.zeros(3),
        np.zeros((n, 3)),
        np.zeros(n),
        np.zeros(n),
        0.0,
        np.zeros((n, 3)),
        np.zeros((n, 3)),
        np.ones(3),
    )
    lag, arm = 0.0, out.arm
    for term, value in acting_terms(values, on, families):
        amount = value * term.weight
        if term.kind == Kind.LAG:
            lag += amount
        elif term.kind == Kind.POINT and term.signal != ONE:
            arm = arm + amount * np.outer(signal(term.signal), np.eye(3)[term.axis])
        elif term.kind in (Kind.POINT, Kind.SCALE):
            (out.arm if term.kind == Kind.POINT else out.longer)[term.axis] += amount
        else:
            now = np.ones(n) if term.signal == ONE else signal(term.signal)
            if term.kind in (Kind.TIME, Kind.COURSE):
                (out.late if term.kind == Kind.TIME else out.course_late)[:] += amount * now
            else:
                target = {Kind.AXIS: out.added, Kind.SLIP: out.slip, Kind.TURN: out.turn}[term.kind]
                target[:, term.axis] += amount * now
    return replace(out, lag=lag, arm=arm)


def acting_terms(values: Values, on: str, families: Sequence[str]) -> Iterable[tuple[Term, float]]:
    """Terms on one measurement whose parameters are not zero, with their values."""
    for name, given in values.items():
        effect = CATALOGUE.get(name)
        if effect is None or effect.markov is not None or effect.family not in families:
            continue
        for term in effect.terms:
            value = float(given.get(term.parameter, 0.0))
            if term.on == on and value != 0.0:
                yield term, value
