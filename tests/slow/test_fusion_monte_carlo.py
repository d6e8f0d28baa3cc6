"""Many simulated drives: near the optimum, and honest about the error.

``--receiver`` chooses receivers: white, phone, u-blox.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.benchmarks.fusion_monte_carlo import (
    COMPONENTS,
    GREATEST_RATIO,
    GREATEST_RATIO_REAL,
    DriveOutcome,
    nees,
    pooled,
    run_drive,
    sigma_ratios,
    stated,
)
from tests.benchmarks.fusion_outages import rms, synthetic
from tests.unit.fusion_receiver import WHITE, receiver_named

DRIVES = 20
SECONDS = 600.0
RECEIVERS = (WHITE,)

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def outcomes(receiver_name: str) -> list[DriveOutcome]:
    receiver = receiver_named(receiver_name)
    known = stated(receiver_name)
    return [run_drive(seed, SECONDS, receiver=receiver, options=known) for seed in range(DRIVES)]


def test_smoothing_is_near_the_exact_optimum(
    outcomes: list[DriveOutcome], receiver_name: str
) -> None:
    """Against a smoother that knows every noise level, every delay and the true linearisation."""
    aim = GREATEST_RATIO.get(receiver_name, GREATEST_RATIO_REAL)
    ours = pooled([o.smoothed for o in outcomes])
    assert ours <= aim * pooled([o.optimal for o in outcomes])
    assert ours <= aim * pooled([o.optimal_constrained for o in outcomes])
    assert ours < 0.9 * pooled([o.filtered for o in outcomes])


def test_errors_are_as_large_as_their_sd(outcomes: list[DriveOutcome]) -> None:
    """The mean of the receiver's wander cannot be told from the place: one draw a drive and
    axis, so the position's ratio over twenty drives scatters by a sixth. Nor can a roll of the
    body be told from angles between the IMU's axes."""
    ratio = dict(zip(COMPONENTS, sigma_ratios(outcomes), strict=True))
    for name in (*COMPONENTS[:3], *COMPONENTS[6:8]):
        assert 0.65 < ratio[name] < 1.4, ratio
    for name in (*COMPONENTS[3:6], COMPONENTS[8]):
        assert 0.85 < ratio[name] < 1.15, ratio


def test_mean_nees_lies_in_its_band(outcomes: list[DriveOutcome]) -> None:
    """Of the attitude a third is a roll that is drawn once a drive: it scatters by a tenth more,
    and lies in the band of independent errors or does not for a whole drive."""
    mean, inside = nees(outcomes)
    assert 0.8 < mean[1] < 1.2
    assert 0.65 < mean[2] < 1.45
    assert (inside[:2] > 0.7).all()


def test_outages_of_a_minute() -> None:
    """Fixes off for 60 s in every 180 s, MEMS sensor: at most 8 m forward, 2 m smoothed."""
    drifts = [synthetic(seed) for seed in range(5)]
    assert rms(list(np.concatenate([forward for forward, _ in drifts]))) < 8.0
    assert rms(list(np.concatenate([smoothed for _, smoothed in drifts]))) < 2.0
