"""Evidence in the boxes of signs: against Bayes factors, and against chance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.gap.camera_scores import Scores, evidence, marginalised, null_maxima
from automap.gap.chance import p_value
from automap.records import FloatArray


def scores_of(phi: FloatArray, w: FloatArray, blocks: int) -> Scores:
    """Scores of rows in so many blocks of one length."""
    parts = phi.reshape(blocks, -1, phi.shape[1])
    score = (phi * w[:, None]).reshape(parts.shape).sum(axis=1)
    return Scores(phi.T @ w, phi.T @ phi, score, np.einsum("bij,bik->bjk", parts, parts))


def test_evidence_is_the_bayes_factor_of_a_linear_model() -> None:
    rng = np.random.default_rng(2)
    phi = rng.standard_normal((300, 2))
    w = phi @ np.array([0.3, -0.2]) + rng.standard_normal(300)
    sd = np.array([0.4, 0.5])
    found = evidence(scores_of(phi, w, 30), np.array([0, 1]), sd)
    cov = np.eye(300) + (phi * sd**2) @ phi.T
    exact = -0.5 * (w @ np.linalg.solve(cov, w) + np.linalg.slogdet(cov)[1]) + 0.5 * w @ w
    assert found.uncorrected == pytest.approx(exact, abs=1e-6)
    assert found.nats <= exact + 1e-6
    assert np.abs(found.estimate - [0.3, -0.2]).max() < 4.0 * found.sd.max()


def test_nuisances_are_taken_out_of_all_others() -> None:
    rng = np.random.default_rng(4)
    phi = rng.standard_normal((300, 3))
    phi[:, 1] += 0.8 * phi[:, 0]
    w = 0.4 * phi[:, 0] + 0.3 * phi[:, 1] + rng.standard_normal(300)
    sd = np.array([0.5, 0.5])
    left = marginalised(scores_of(phi, w, 30), np.array([0]), sd[:1])
    found = evidence(left, np.array([1]), sd[1:])
    both, alone = (evidence(scores_of(phi, w, 30), np.arange(k), sd[:k]) for k in (2, 1))
    assert found.uncorrected == pytest.approx(both.uncorrected - alone.uncorrected, abs=1e-6)
    assert not left.score[0]
    assert not left.info[0].any()


def test_signs_that_disagree_lower_the_evidence() -> None:
    rng = np.random.default_rng(5)
    phi = np.ones((600, 1))
    w = 0.4 + rng.standard_normal(600)
    apart = np.repeat(0.6 * rng.standard_normal(30), 20)
    even, uneven = (
        evidence(scores_of(phi, rows, 30), np.array([0]), np.ones(1)) for rows in (w, w + apart)
    )
    assert even.overdispersion < 1.5
    assert uneven.overdispersion > 2.0
    assert uneven.nats < uneven.uncorrected - 5.0


def test_p_values_of_the_largest_evidence_are_uniform() -> None:
    rng = np.random.default_rng(3)
    phi = rng.standard_normal((200, 6))
    info = phi.T @ phi
    flat = Scores(np.zeros(6), info, np.zeros((0, 6)), np.zeros((0, 6, 6)))
    groups = [(np.array([i]), np.array([0.3])) for i in range(4)]
    groups.append((np.array([4, 5]), np.array([0.3, 0.3])))
    maxima = null_maxima(flat, groups, 4000)
    values = []
    for _ in range(300):
        g = phi.T @ rng.standard_normal(200)
        scores = replace(flat, score=g)
        values.append(p_value(max(evidence(scores, c, s).nats for c, s in groups), maxima))
    assert 0.42 < float(np.mean(values)) < 0.58
    assert float(np.mean(np.array(values) < 0.05)) < 0.1
    # and falls on beyond the largest draw
    assert p_value(float(maxima[-1]) + 20.0, maxima) < 1e-6


def test_scores_of_two_drives_add_up() -> None:
    rng = np.random.default_rng(6)
    phi, w = rng.standard_normal((200, 2)), rng.standard_normal(200)
    both = scores_of(phi[:100], w[:100], 10) + scores_of(phi[100:], w[100:], 10)
    whole = scores_of(phi, w, 20)
    for part in ("score", "info", "blocks", "block_info"):
        np.testing.assert_allclose(getattr(both, part), getattr(whole, part))
