"""Which candidates of a screening are worth a fit."""

from __future__ import annotations

import numpy as np

from automap.gap.evidence import Evidence, Scores
from automap.gap.screening import Candidate, Screening
from automap.gap.shortlist import shortlist


def screening_of(**found: tuple[float, float]) -> Screening:
    """A screening of effects with their nats and those before scatter lowered them."""
    one = np.ones(1)
    candidates = [
        Candidate(e, ("p",), np.array([0]), one, Evidence(nats, one, one, 1.0, 1.0, bare), 0.0)
        for e, (nats, bare) in found.items()
    ]
    scores = Scores(one, np.eye(1), np.zeros((0, 1)), np.zeros((0, 1, 1)))
    return Screening(tuple(candidates), (), scores, one)


def names_of(screening: Screening) -> list[str]:
    return [c.effect for c in shortlist(screening)]


def test_weak_candidates_are_not_fitted() -> None:
    found = screening_of(speed_vibration=(40.0, 45.0), accel_quadratic=(2.0, 10.0))
    assert names_of(found) == ["speed_vibration"]


def test_a_leader_but_for_the_scatter_of_its_score_is_fitted() -> None:
    found = screening_of(
        speed_vibration=(18.0, 66.0), gyro_g_sensitivity=(0.8, 109.0), accel_quadratic=(0.5, 60.0)
    )
    assert names_of(found) == ["speed_vibration", "gyro_g_sensitivity"]


def test_scatter_alone_makes_no_candidate() -> None:
    assert names_of(screening_of(gyro_g_sensitivity=(1.0, 109.0))) == []
