"""Which of two fits of the same drives is likelier, and how surely."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from automap.fusion.layout import CH_NHC
from automap.gap import scoring
from automap.gap.fit import Fit
from automap.gap.joint import combine
from automap.gap.scoring import likelier
from automap.records import FloatArray

LENGTH_S, ROWS = 800.0, 4000
T = np.linspace(0.0, LENGTH_S, ROWS)


@pytest.fixture(autouse=True)
def given_innovations(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scoring, "whitened_innovations", lambda fit: fit.whitened)


def fit_with(off: FloatArray, sd: float = 1.0) -> Fit:
    """A fit whose innovations are this far off, with such a sigma."""
    channel = np.zeros(ROWS, np.int64)
    store = SimpleNamespace(var=np.full(ROWS, sd**2))
    last = SimpleNamespace(nodes=SimpleNamespace(t=T), forward=SimpleNamespace(store=store))
    return cast("Fit", SimpleNamespace(last=last, whitened=(off / sd, T, channel)))


def noise(seed: int = 1) -> FloatArray:
    return np.random.default_rng(seed).standard_normal(ROWS)


def test_the_fit_with_smaller_innovations_is_likelier() -> None:
    right = noise()
    wrong = right + 0.5 * np.sin(2.0 * np.pi * T / 90.0)
    nats, sigmas = likelier([fit_with(right)], [fit_with(wrong)])
    # half of a mean square of 0.125 a row
    assert nats == pytest.approx(0.5 * 0.125 * ROWS, rel=0.5)
    assert sigmas > 5.0
    back = likelier([fit_with(wrong)], [fit_with(right)])
    assert back == pytest.approx((-nats, -sigmas))


def test_drives_add_up() -> None:
    right, wrong = noise(), noise() + 0.5 * np.sin(2.0 * np.pi * T / 90.0)
    one, sure = likelier([fit_with(right)], [fit_with(wrong)])
    three, surer = likelier([fit_with(right)] * 3, [fit_with(wrong)] * 3)
    assert three == pytest.approx(3.0 * one)
    assert surer == pytest.approx(np.sqrt(3.0) * sure)


def test_sigmas_of_the_innovations_count_too() -> None:
    right = noise()
    wide = fit_with(right, 2.0)
    nats, _ = likelier([fit_with(right)], [wide])
    # a Gaussian would say log 2 - 3/8 a row; whiteners that mend the sigma leave part of it
    assert 0.1 * ROWS < nats < ROWS * (np.log(2.0) - 0.375)


def test_the_same_fit_is_not_likelier_than_itself() -> None:
    fit = fit_with(noise())
    assert likelier([fit], [fit]) == (0.0, 0.0)


def test_what_one_stretch_alone_says_is_not_sure() -> None:
    right = noise()
    wrong = right + np.where((T > 200.0) & (T < 208.0), 4.0, 0.0)
    nats, sigmas = likelier([fit_with(right)], [fit_with(wrong)])
    assert nats > 20.0
    assert sigmas < 1.5


def test_differences_by_chance_are_few_sigmas() -> None:
    told = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        base, sway = rng.standard_normal(ROWS), 0.3 * rng.standard_normal((2, ROWS))
        told.append(likelier([fit_with(base + sway[0])], [fit_with(base + sway[1])])[1])
    assert abs(float(np.mean(told))) < 0.5
    assert 0.6 < float(np.std(told)) < 1.5


def test_a_few_wild_values_decide_nothing() -> None:
    right = noise()
    worse, wild = right + 0.3 * np.sin(2.0 * np.pi * T / 90.0), right.copy()
    wild[::1000] = 60.0
    nats, _ = likelier([fit_with(wild)], [fit_with(worse)])
    plain = 0.5 * float(np.sum(worse**2) - np.sum(wild**2))
    assert plain < -5000.0
    assert nats > plain / 10.0


def test_drives_are_combined_as_if_filtered_in_a_row() -> None:
    rng = np.random.default_rng(2)
    prior = np.array([0.5, 2.0])
    infos = [m @ m.T + np.eye(2) for m in rng.standard_normal((3, 2, 2))]
    scores = rng.standard_normal((3, 2))
    names = (("gyro_scale", "x"), ("gyro_scale", "y"))
    fits = []
    for info, score in zip(infos, scores, strict=True):
        cov = np.linalg.inv(info + np.diag(prior**-2.0))
        fits.append(cast("Fit", SimpleNamespace(names=names, values=cov @ score, cov=cov)))
    found = combine(fits, [0.0] * 3, prior)
    cov = np.linalg.inv(sum(infos) + np.diag(prior**-2.0))
    np.testing.assert_allclose(found.cov, cov, rtol=1e-6)
    np.testing.assert_allclose(found.values, cov @ scores.sum(axis=0), rtol=1e-6)
    value, sd = found.of("gyro_scale")["y"]
    assert (value, sd) == pytest.approx((found.values[1], np.sqrt(cov[1, 1])))
    nothing = combine([cast("Fit", SimpleNamespace(names=()))], [2.0], np.zeros(0))
    assert (nothing.names, nothing.nats) == ((), 2.0)


def test_channels_of_the_constraint_have_a_whitener_of_their_own() -> None:
    right = noise()
    channel = np.where(np.arange(ROWS) % 2, CH_NHC, 0)
    fit = fit_with(right)
    vars(fit)["whitened"] = (np.where(channel == CH_NHC, 0.1, 1.0) * right, T, channel)
    spread = scoring.whitener_of(fit).spread
    # small innovations of a loose constraint do not make it count for more
    assert spread[CH_NHC] == 1.0
    assert spread[0] == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("moved", [0.0, 1e-4])
def test_what_only_one_of_two_was_asked_says_nothing_of_them(moved: float) -> None:
    # the vehicle constraint at a last node where one path is a little quicker, and nodes that a
    # delay has moved
    one, other = fit_with(noise()), fit_with(1.5 * noise(2))
    w, t, channel = vars(one)["whitened"]
    vars(one)["whitened"] = np.append(w, 0.0), np.append(t, t[-1]), np.append(channel, CH_NHC)
    vars(one.last.forward.store)["var"] = np.append(np.ones(ROWS), 1e-6)
    w, t, channel = vars(other)["whitened"]
    vars(other)["whitened"] = w, t + moved, channel
    vars(other.last.nodes)["t"] = T + moved
    plain = fit_with(noise())
    assert likelier([one], [other])[0] == pytest.approx(likelier([plain], [other])[0], rel=1e-3)
