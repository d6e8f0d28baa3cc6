"""Effects of which few parameters act."""

from __future__ import annotations

import numpy as np
import pytest

from automap.gap.evidence import Scores, evidence, null_maxima
from automap.gap.sparse import choices, estimate_nats, sparse_gain
from automap.records import FloatArray


@pytest.mark.parametrize("p", [1, 2, 3, 4, 6, 9])
def test_the_choices_share_one_prior(p: int) -> None:
    every = choices(p)
    assert np.exp([weight for _, weight in every]).sum() == pytest.approx(1.0)
    assert len({tuple(acting) for acting, _ in every}) == len(every)
    assert any(len(acting) == p for acting, _ in every)


def _scores(info: FloatArray, score: FloatArray) -> Scores:
    p = len(score)
    return Scores(score, info, np.zeros((0, p)), np.zeros((0, p, p)))


def _info(p: int) -> FloatArray:
    rng = np.random.default_rng(p)
    root = rng.standard_normal((3 * p, p))
    return np.asarray(200.0 * root.T @ root)


def _posterior(scores: Scores, prior_sd: FloatArray) -> tuple[FloatArray, FloatArray]:
    cov = np.linalg.inv(scores.info + np.diag(prior_sd**-2.0))
    return cov @ scores.score, cov


@pytest.mark.parametrize("p", [1, 3, 6])
def test_estimate_and_score_say_the_same(p: int) -> None:
    """The gain over the full effect is the same by Savage and Dickey, from the estimate, and by the
    evidences of the choices, from the score."""
    prior_sd = np.full(p, 0.3)
    info = _info(p)
    true = np.zeros(p)
    true[0] = 0.2
    scores = _scores(info, info @ true)
    columns = np.arange(p)
    full = evidence(scores, columns, prior_sd).nats
    few = evidence(scores, columns, prior_sd, sparse=True).nats
    assert few - full == pytest.approx(sparse_gain(*_posterior(scores, prior_sd), prior_sd))


def test_an_estimate_is_worth_what_its_score_is() -> None:
    p = 3
    prior_sd, info = np.full(p, 0.3), _info(3)
    scores = _scores(info, info @ np.array([0.05, 0.0, -0.1]))
    full = evidence(scores, np.arange(p), prior_sd).nats
    assert estimate_nats(*_posterior(scores, prior_sd), prior_sd) == pytest.approx(full)
    # what is not known at all is worth nothing
    assert estimate_nats(np.zeros(p), np.diag(prior_sd**2), prior_sd) == pytest.approx(
        0.0, abs=1e-9
    )


def test_one_axis_of_nine_is_likelier_than_all() -> None:
    p = 9
    prior_sd, info = np.full(p, 0.3), _info(9)
    one, every = np.zeros(p), np.full(p, 0.2)
    one[4] = 0.2
    columns = np.arange(p)
    gains = []
    for true in (one, every):
        scores = _scores(info, info @ true)
        full = evidence(scores, columns, prior_sd).nats
        gains.append(evidence(scores, columns, prior_sd, sparse=True).nats - full)
    assert gains[0] > 5.0
    # what does not pay pays the choice alone
    assert -np.log(3.0) - 1e-9 < gains[1] < 0.0


def test_chance_finds_few_parameters_no_oftener_than_it_should() -> None:
    """A Bayes factor of e^x comes by chance no oftener than e^-x, each effect counted."""
    p = 6
    info = _info(p)
    groups = [(np.arange(p), np.full(p, 0.3)), (np.arange(3), np.full(3, 0.3))]
    maxima = null_maxima(_scores(info, np.zeros(p)), groups, 20000, sparse=True)
    for nats in (3.0, 4.0, 5.0):
        # two effects, each with two prior scales
        assert np.mean(maxima > nats) < 4.0 * np.exp(-nats)
