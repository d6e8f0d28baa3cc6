"""What innovations say of the sigmas: true, and in words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.fusion.consistency import (
    channel_consistency,
    innovation_doubts,
    on_straights,
    slides,
)
from automap.fusion.output import Innovations
from automap.records import Trajectory


def _table(size: float = 1.0, memory: float = 0.0, n: int = 600, slip: float = 0.0) -> Innovations:
    """Innovations of three channels; position's are ``size`` times their sd, and remember; the
    vehicle slides by ``slip`` sds all the time."""
    rng = np.random.default_rng(4)
    parts = []
    for name in ("position_n", "velocity_e", "nhc_y"):
        noise = rng.standard_normal(n)
        if name == "position_n":
            for i in range(1, n):
                noise[i] = memory * noise[i - 1] + np.sqrt(1.0 - memory**2) * noise[i]
            noise *= size
        if name == "nhc_y":
            noise = 0.1 * noise + slip
        parts.append((name, 2.0 * noise))
    return Innovations(
        np.tile(np.arange(n), 3),
        np.repeat(np.array([name for name, _ in parts], dtype=object), n),
        np.concatenate([values for _, values in parts]),
        np.full(3 * n, 2.0),
        np.ones(3 * n),
        np.ones(3 * n, dtype=bool),
    )


def test_channels_are_measured() -> None:
    channels = channel_consistency(_table(size=2.0, memory=0.6))
    assert channels["position_n"].normalised_rms == pytest.approx(2.0, rel=0.1)
    assert channels["position_n"].lag1 == pytest.approx(0.6, abs=0.1)
    assert channels["velocity_e"].lag1 == pytest.approx(0.0, abs=0.1)


def test_right_innovations_give_no_reason() -> None:
    assert innovation_doubts(channel_consistency(_table())) == []


def test_sigmas_too_small_are_told_and_where() -> None:
    (reason,) = innovation_doubts(channel_consistency(_table(size=2.5)))
    assert "innovations of position north are 2.5" in reason.text
    assert "velocity" not in reason.text
    assert "nhc" not in reason.text
    assert reason.factor == pytest.approx(2.5, rel=0.1)


@pytest.mark.parametrize(("slip", "told"), [(0.0, False), (0.05, False), (0.5, True)])
def test_a_slip_that_lasts_is_told_though_each_innovation_is_small(slip: float, told: bool) -> None:
    reasons = slides(channel_consistency(_table(slip=slip)))
    assert [reason.code for reason in reasons] == ["vehicle_slides"] * told
    assert all(reason.factor > 2.0 for reason in reasons)


@pytest.mark.parametrize("everywhere", [True, False])
def test_courses_that_come_late_are_no_slide_of_the_vehicle(everywhere: bool) -> None:
    """Corners of 90 deg in 3 s, every 20 s, and a nose that follows courses 0.8 s late."""
    t = np.arange(600.0)
    yaw = np.deg2rad(90.0) * np.cumsum((t % 20.0) < 3.0) / 3.0
    zero, three = np.zeros(600), np.zeros((600, 3))
    rpy = np.column_stack([zero, zero, np.angle(np.exp(1j * yaw))])
    path = Trajectory((t * 1e9).astype(np.int64), t, zero, zero, zero, three, rpy, *[three] * 3)
    table = _table(slip=2.0)
    bent = np.tile((t % 20.0) < 6.0, 3) | everywhere
    table = replace(
        table,
        t_ns=table.t_ns * 10**9,
        innovation=np.where(bent | (table.channel != "nhc_y"), table.innovation, 0.0),
    )
    assert slides(channel_consistency(table)) != []
    late = slides(channel_consistency(on_straights(table, path, 0.8)))
    assert bool(late) == everywhere


def test_errors_that_resemble_their_neighbours_count_for_fewer() -> None:
    # the mean of n errors with neighbours alike by r errs as that of n (1 - r) / (1 + r)
    (reason,) = innovation_doubts(channel_consistency(_table(memory=0.8)))
    rng = np.random.default_rng(1)
    noise = rng.standard_normal((4000, 400))
    for i in range(1, noise.shape[1]):
        noise[:, i] = 0.8 * noise[:, i - 1] + 0.6 * noise[:, i]
    real = noise.mean(axis=1).std() * np.sqrt(noise.shape[1])
    assert "resemble each other (correlation 0." in reason.text
    assert 0.6 * real < reason.factor < 1.1 * real


def test_small_innovations_are_no_reason() -> None:
    assert innovation_doubts(channel_consistency(_table(size=0.3))) == []


def test_too_few_are_not_judged() -> None:
    assert innovation_doubts(channel_consistency(_table(size=9.0, n=10))) == []
