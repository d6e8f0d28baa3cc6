"""What no candidate explains: told by channel, frequency, time and manoeuvre; noise is not."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from automap.fusion.layout import CHANNELS
from automap.gap import limits, misfit
from automap.gap.fit import Fit
from automap.gap.motion import Motion
from automap.records import FloatArray

STEP_S, LENGTH_S = 0.5, 600.0
T = np.arange(0.0, LENGTH_S, STEP_S)
MEASURED = 6
VELOCITY_N = 3


FIT = cast(
    "Fit",
    SimpleNamespace(last=None, opened=SimpleNamespace(drive=SimpleNamespace(begin_s=0.0))),
)


@lru_cache
def motion() -> Motion:
    """Speeds, turns and accelerations at rates that have nothing to do with one another."""
    t = np.arange(0.0, LENGTH_S, 0.1)
    n = len(t)
    vel = np.zeros((n, 3))
    vel[:, 0] = 10.0 + 6.0 * np.sin(2.0 * np.pi * t / 83.0)
    rate, acc = np.zeros((n, 3)), np.zeros((n, 3))
    rate[:, 2] = 0.2 * np.sin(2.0 * np.pi * t / 29.0)
    acc[:, 0] = np.sin(2.0 * np.pi * t / 17.0)
    dcm = np.tile(np.eye(3), (n, 1, 1))
    return Motion(t, np.zeros((n, 3)), vel, dcm, rate, acc, acc, rate)


def speed_at(t: FloatArray) -> FloatArray:
    return np.asarray(np.interp(t, motion().t, motion().vel[:, 0]))


def found(rows: FloatArray, monkeypatch: pytest.MonkeyPatch) -> tuple[misfit.Misfit, ...]:
    """Misfits of a drive whose channels have these innovations [s, 6] over their sds."""
    t, channel = np.repeat(T, MEASURED), np.tile(np.arange(MEASURED), len(T))
    monkeypatch.setattr(misfit, "whitened_innovations", lambda fit: (rows.ravel(), t, channel))
    monkeypatch.setattr(misfit, "motion_of", lambda last: motion())
    return misfit.misfits([FIT])


def white(seed: int) -> FloatArray:
    return np.random.default_rng(seed).standard_normal((len(T), MEASURED))


@pytest.mark.parametrize("size", [1.0, 0.3])
def test_white_innovations_have_no_misfit(size: float, monkeypatch: pytest.MonkeyPatch) -> None:
    for seed in range(8):
        assert found(size * white(seed), monkeypatch) == ()


def test_a_period_is_told_by_its_band(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = white(1)
    rows[:, VELOCITY_N] += np.sin(2.0 * np.pi * T / 40.0)
    first, *rest = found(rows, monkeypatch)
    assert (first.channel, first.kind) == (CHANNELS[VELOCITY_N], "band")
    shortest, longest = (float(x) for x in first.where.split()[2::2][:2])
    assert shortest <= 40.0 <= longest
    assert first.size > 3.0
    assert first.p_value < 1e-6
    assert all(m.size <= first.size for m in rest)
    assert {m.channel for m in rest} <= {CHANNELS[VELOCITY_N]}


def test_a_stretch_of_noise_is_told_by_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = white(2)
    rows[(T > 300.0) & (T < 375.0), 0] *= 2.0
    told = found(rows, monkeypatch)
    first = next(m for m in told if m.kind == "time")
    assert first.channel == CHANNELS[0]
    begin, end = (float(x) for x in first.where.split()[0:3:2])
    assert (begin, end) == pytest.approx((300.0, 375.0), abs=2.0)
    assert first.size == pytest.approx(4.0, rel=0.3)


def test_noise_at_speed_is_told_by_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = white(3)
    fast = speed_at(T) > 13.0
    rows[fast, VELOCITY_N] *= 2.0
    told = [m for m in found(rows, monkeypatch) if m.kind == "speed"]
    begin, end = (float(x) for x in told[0].where.split()[0:3:2])
    assert begin > 11.0
    assert end == pytest.approx(16.0, abs=0.1)


def test_a_wild_fix_is_no_misfit(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = white(4)
    rows[500, 2] = 80.0
    assert found(rows, monkeypatch) == ()


def test_noise_that_is_a_little_large_is_no_misfit(monkeypatch: pytest.MonkeyPatch) -> None:
    # all sigmas are off by a sixth, which so many rows show surely
    told = found(1.17 * white(6), monkeypatch)
    assert all(m.size >= limits.WORTH for m in told)
    assert len(told) < 0.2 * len(found(1.5 * white(6), monkeypatch))


@pytest.mark.parametrize("look", [misfit._bands, misfit._conditions])
def test_chances_of_single_looks_are_uniform(
    look: Callable[[list[Fit], int], list[misfit.Misfit]], monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[float] = []
    for seed in range(12):
        found(white(seed), monkeypatch)
        told += [m.p_value for c in range(MEASURED) for m in look([FIT], c)]
    values = np.array(told)
    assert float(values.mean()) == pytest.approx(0.5, abs=0.06)
    assert float(np.mean(values < 0.1)) == pytest.approx(0.1, abs=0.04)


def test_too_few_rows_say_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = 3.0 * white(5)
    few = limits.MISFIT_ROWS - 1
    monkeypatch.setattr(f"{__name__}.T", T[:few])
    assert found(rows[:few], monkeypatch) == ()
