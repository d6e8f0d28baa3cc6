"""Evidence of candidates: against Bayes factors computed otherwise, and against chance."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from automap.fusion.layout import CH_NHC, CH_POS, MAX_SCALARS
from automap.gap import chance, limits
from automap.gap.chance import null_maxima, p_value, strongest_by_chance
from automap.gap.evidence import (
    between_channels,
    evidence,
    inflation,
    nats_of_parts,
    plain_nats,
    singles,
)
from automap.gap.joint import estimate_nats
from automap.gap.linear import Direct, Given, Linear, conditional
from automap.records import FloatArray
from tests.unit.gap_linear import PRIOR_SD, columns_named, linear_of

ROWS = 3000


def drive(theta: FloatArray, seed: int = 1, noise: FloatArray | float = 1.0) -> Linear:
    """Rows that columns at random explain in part."""
    rng = np.random.default_rng(seed)
    phi = 0.1 * rng.standard_normal((ROWS, len(theta)))
    w = phi @ theta + noise * rng.standard_normal(ROWS)
    return linear_of(phi, w, columns_named(*(f"e{i}.p" for i in range(len(theta)))))


def log_density(w: FloatArray, phi: FloatArray, sd: FloatArray) -> float:
    """Of rows under columns of these prior sds, up to a constant."""
    cov = np.eye(len(w)) + (phi * sd**2) @ phi.T
    return float(-0.5 * (w @ np.linalg.solve(cov, w) + np.linalg.slogdet(cov)[1]))


@pytest.mark.parametrize("size", [0.0, 0.3, 2.5])
def test_evidence_of_one_parameter_is_its_bayes_factor(size: float) -> None:
    linear = drive(np.array([size]))
    (rows,) = linear.rows
    phi = rows.phi[:, 0]
    theta = np.linspace(-20.0, 20.0, 40001)
    # by how much rows are likelier with each value than with none
    gain = theta * (phi @ rows.w) - 0.5 * theta**2 * (phi @ phi)
    factors = []
    for scale in limits.PRIOR_SCALES:
        sd = scale * PRIOR_SD
        prior = np.exp(-0.5 * (theta / sd) ** 2) / (sd * np.sqrt(2.0 * np.pi))
        factors.append(np.trapezoid(np.exp(gain - gain.max()) * prior, theta))
    expected = np.log(max(factors)) + gain.max() - np.log(len(limits.PRIOR_SCALES))
    found = evidence(conditional(linear, Given()), (0,))
    assert found.uncorrected == pytest.approx(expected, abs=1e-6)
    assert found.scale == limits.PRIOR_SCALES[int(np.argmax(factors))]
    assert singles(conditional(linear, Given()), np.array([0]))[0] == pytest.approx(expected)


def test_evidence_beside_others_is_the_ratio_of_two_models() -> None:
    (rows,) = drive(np.array([0.8, 0.6, -0.7])).rows
    # what is given overlaps with the candidate
    phi, w = 5.0 * rows.phi[:400], rows.w[:400]
    phi[:, 1] += 0.7 * phi[:, 0]
    linear = linear_of(phi, w, columns_named("e0.p", "e1.p", "e1.q"))
    known = conditional(linear, Given().joined((0,), linear, 5.0))
    nats, scale = plain_nats(known, (1, 2))
    sd = np.array([5.0, scale, scale]) * PRIOR_SD
    expected = log_density(w, phi, sd) - log_density(w, phi[:, :1], sd[:1])
    assert nats == pytest.approx(expected - np.log(len(limits.PRIOR_SCALES)), abs=1e-6)


def test_an_estimate_is_worth_what_its_score_is() -> None:
    linear = drive(np.array([0.8, 0.0, -0.9]))
    part = (0, 1, 2)
    nats, scale = plain_nats(conditional(linear, Given()), part)
    prior_sd = np.asarray(scale * linear.prior_sd, np.float64)
    cov = np.linalg.inv(linear.info + np.diag(prior_sd**-2.0))
    told = estimate_nats(np.asarray(cov @ linear.score), np.asarray(cov, np.float64), prior_sd)
    assert told - np.log(len(limits.PRIOR_SCALES)) == pytest.approx(nats)
    # what is not known at all is worth nothing
    nothing = estimate_nats(np.zeros(3), np.diag(prior_sd**2), prior_sd)
    assert nothing == pytest.approx(0.0, abs=1e-9)


def test_noise_that_lasts_lowers_evidence_and_widens_sigmas() -> None:
    rng = np.random.default_rng(4)
    # each stretch has a value of its own: the mean of all is known worse than rows say
    phi = 0.1 * np.ones((ROWS, 1))
    lasting = np.repeat(rng.standard_normal(ROWS // 100), 100)
    w = 0.3 + rng.standard_normal(ROWS)
    even = linear_of(phi, w, columns_named("e.p"))
    coloured = linear_of(phi, w + 0.5 * lasting, columns_named("e.p"))
    found = [evidence(conditional(one, Given()), (0,)) for one in (even, coloured)]
    assert found[0].overdispersion < 1.8
    assert found[1].overdispersion > 4.0
    assert found[1].nats < found[1].uncorrected - 2.0
    assert found[1].sd[0] > 2.0 * found[0].sd[0]
    # corrected by what the other scatters
    assert found[1].corrected(found[1].overdispersion) == pytest.approx(found[1].nats)
    assert found[1].corrected(1.0) == found[1].uncorrected


def test_what_one_stretch_alone_shows_is_not_predicted_without_it() -> None:
    rng = np.random.default_rng(5)
    phi = 0.1 * rng.standard_normal((ROWS, 1))
    w = rng.standard_normal(ROWS)
    everywhere = w + 1.5 * phi[:, 0]
    once = w + np.where(np.arange(ROWS) < 400, 11.0, 0.0) * phi[:, 0]
    found = [
        evidence(conditional(linear_of(phi, rows, columns_named("e.p")), Given()), (0,))
        for rows in (everywhere, once)
    ]
    assert all(one.uncorrected > 10.0 for one in found)
    assert found[0].predicted_without_best > 5.0
    # one of six stretches that say the same
    assert 0.6 < found[0].predicted_without_best / found[0].predicted < 0.95
    assert found[1].predicted_without_best < 0.0


def test_what_is_given_does_not_scatter_the_score_of_others() -> None:
    strong = 25.0
    linear = drive(np.array([strong, 2.0]))
    (rows,) = linear.rows
    phi = rows.phi.copy()
    phi[:, 1] += 0.7 * phi[:, 0]
    w = rows.w + 2.0 * (phi[:, 1] - rows.phi[:, 1])
    beside = linear_of(phi, w, linear.layout)
    wide = replace(beside, prior_sd=np.array([20.0, PRIOR_SD]))
    found = evidence(conditional(wide, Given().joined((0,), wide, 5.0)), (1,))
    alone = linear_of(rows.phi, rows.w - strong * rows.phi[:, 0], linear.layout)
    right = evidence(conditional(alone, Given()), (1,))
    assert found.overdispersion == pytest.approx(right.overdispersion, rel=0.1)
    assert found.nats == pytest.approx(right.nats, rel=0.15)
    assert found.predicted == pytest.approx(right.predicted, rel=0.15)


def test_p_values_of_the_largest_evidence_are_uniform() -> None:
    linear = drive(np.zeros(20))
    # most candidates are nearly one, one has several parameters, beside one that is given
    rows = linear.rows[0]
    rows.phi[:, 6:] = 3.0 * rows.phi[:, 6:7] + rows.phi[:, 6:]
    given = Given().joined((0,), linear, 1.0)
    parts = [(1,), (2, 3, 4), *((i,) for i in range(5, 20))]
    linear = linear_of(rows.phi, rows.w, linear.layout)
    maxima = null_maxima(conditional(linear, given), parts, limits.NULL_DRAWS)
    values = []
    for seed in range(300):
        rng = np.random.default_rng(seed)
        w = rng.standard_normal(ROWS) + PRIOR_SD * rng.standard_normal() * rows.phi[:, 0]
        known = conditional(replace(linear, score=rows.phi.T @ w), given)
        best = max(
            singles(known, np.array([p[0] for p in parts if len(p) == 1])).max(),
            plain_nats(known, parts[1])[0],
        )
        values.append(p_value(best, maxima))
    told = np.array(values)
    assert 0.42 < float(told.mean()) < 0.58
    for share in (0.05, 0.2, 0.5, 0.8):
        assert float(np.mean(told < share)) == pytest.approx(
            share, abs=4.0 * np.sqrt(share * (1.0 - share) / len(told))
        )


PARTS = [(1,), (2, 3, 4), *((i,) for i in range(5, 20))]
"""Of twenty columns the first is given."""


def uneven(seed: int, theta: float = 0.0) -> Linear:
    """Rows whose noise lasts for seconds and is three times as large in some stretches; the second
    column acts by ``theta``."""
    rng = np.random.default_rng(seed)
    linear = drive(np.zeros(20), seed)
    (rows,) = linear.rows
    # columns that last as long are what noise that lasts is taken for
    kernel = np.ones(12) / np.sqrt(12.0)
    phi, noise = (
        np.stack([np.convolve(column, kernel, mode="same") for column in each.T], axis=1)
        for each in (rows.phi, rng.standard_normal((ROWS, 1)))
    )
    loud = np.repeat(rng.choice([1.0, 3.0], ROWS // 30), 30)
    return linear_of(phi, loud * noise[:, 0] + theta * phi[:, 1], linear.layout)


@pytest.mark.slow
def test_chances_by_the_drives_own_scatter_hold_where_noise_is_not_as_modelled() -> None:
    told, modelled = [], []
    for seed in range(200):
        linear = uneven(seed)
        known = conditional(linear, Given().joined((0,), linear, 1.0))
        found = strongest_by_chance(known, PARTS, 500)
        assert found is not None
        told.append(found.p_value)
        maxima = null_maxima(known, PARTS, 200)
        modelled.append(p_value(max(plain_nats(known, part)[0] for part in PARTS), maxima))
    for share in (0.05, 0.2):
        room = 4.0 * np.sqrt(share * (1.0 - share) / len(told))
        assert float(np.mean(np.array(told) <= share)) < share + room
    # the model's own noise lets nothing pass for chance here
    assert float(np.mean(np.array(modelled) < 0.05)) > 0.9


def test_many_parts_at_once_have_the_nats_of_each() -> None:
    rng = np.random.default_rng(11)
    phi = rng.standard_normal((60, 7))
    linear = linear_of(
        phi, phi @ rng.standard_normal(7), columns_named(*(f"e{i}.p" for i in range(7)))
    )
    parts = [(1,), (2, 3), (4,), (5, 6), (1, 2), (1, 3, 5)]
    for given in (Given(), Given().joined((0,), linear, 1.0)):
        known = conditional(linear, given)
        each = [plain_nats(known, part)[0] for part in parts]
        np.testing.assert_allclose(nats_of_parts(known, parts), each, rtol=1e-10)


def test_what_every_stretch_says_alike_is_no_chance() -> None:
    linear = uneven(1, theta=15.0)
    known = conditional(linear, Given().joined((0,), linear, 1.0))
    found = strongest_by_chance(known, PARTS, limits.NULL_DRAWS)
    assert found is not None
    assert PARTS[found.number] == (1,)
    assert found.p_value <= limits.SUSPECTED
    # no chance is told below that of the draw in which no sign is turned
    assert found.p_value >= 1.0 / limits.NULL_DRAWS


def test_nothing_is_the_strongest_of_none() -> None:
    assert strongest_by_chance(conditional(drive(np.zeros(2)), Given()), [], 10) is None


def test_p_values_fall_on_beyond_the_largest_draw() -> None:
    rng = np.random.default_rng(6)
    maxima = np.sort(rng.exponential(size=limits.NULL_DRAWS))
    assert p_value(-1.0, maxima) == 1.0
    assert p_value(1.0, maxima) == pytest.approx(np.exp(-1.0), rel=0.1)
    # an exponential tail goes on as it is
    assert p_value(12.0, maxima) == pytest.approx(np.exp(-12.0), rel=0.8)
    told = [p_value(x, maxima) for x in np.linspace(0.0, 20.0, 200)]
    assert all(a >= b for a, b in pairwise(told))


def test_courses_of_more_columns_than_rows_have_null_draws(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(7)
    phi = rng.standard_normal((20, 5)) @ rng.standard_normal((5, 30))
    linear = linear_of(phi, np.zeros(20), columns_named(*(f"e{i}.p" for i in range(30))))
    known, parts = conditional(linear, Given()), [*((i,) for i in range(28)), (28, 29)]
    found = null_maxima(known, parts, 200)
    assert np.isfinite(found).all()
    assert (np.diff(found) >= 0.0).all()
    # however many are drawn at a time, to the rounding that products of other shapes have of
    # columns of which 25 are sums of others
    monkeypatch.setattr(chance, "DRAWS", 77)
    np.testing.assert_allclose(null_maxima(known, parts, 200), found, rtol=1e-3)


def test_what_is_left_of_nearly_the_same_shows_nothing() -> None:
    linear = drive(np.zeros(2))
    (rows,) = linear.rows
    given = Given().joined((0,), linear, 5.0)
    for own, shown in ((0.05, False), (0.3, True)):
        phi = rows.phi.copy()
        phi[:, 1] = phi[:, 0] + own * rows.phi[:, 1]
        known = conditional(linear_of(phi, rows.w, linear.layout), given)
        assert known.shows((1,)) is shown
        assert conditional(known.linear, Given()).shows((1,))


def with_constraint(receiver: float, vehicle: float, in_turns: bool = False) -> Linear:
    """Rows of a receiver and of the vehicle constraint that tell these values of one parameter,
    two stretches of the one and two of the other ``in_turns``."""
    rng = np.random.default_rng(4)
    phi = 0.1 * rng.standard_normal((ROWS, 1))
    loose = np.arange(ROWS) % 3 == 0
    if in_turns:
        loose = np.arange(ROWS) // 750 % 2 == 0
    w = phi[:, 0] * np.where(loose, vehicle, receiver) + rng.standard_normal(ROWS)
    linear = linear_of(phi, w, columns_named("e0.p"))
    (rows,) = linear.rows
    channel = np.where(loose, CH_NHC, CH_POS)
    return replace(linear, rows=(replace(rows, channel=channel),))


def test_the_constraint_has_no_say_where_the_receiver_contradicts_it() -> None:
    both = evidence(conditional(with_constraint(2.0, 2.0), Given()), (0,))
    assert both.estimate[0] == pytest.approx(2.0, abs=3.0 * both.sd[0])
    apart = evidence(conditional(with_constraint(0.0, 4.0), Given()), (0,))
    # all that is shown is the vehicle's doing
    assert apart.nats < 3.0 < 15.0 < both.nats
    assert abs(apart.estimate[0]) < 3.0 * apart.sd[0]


def test_a_contradiction_does_not_hide_in_the_scatter_that_it_makes() -> None:
    linear = with_constraint(0.0, 1.5, in_turns=True)
    found = evidence(conditional(linear, Given()), (0,))
    # about a common value the stretches of either scatter by several times what noise makes
    assert found.nats < 0.0
    assert abs(found.estimate[0]) < 3.0 * found.sd[0]


def test_what_acts_on_the_constraint_itself_may_show_there_alone() -> None:
    linear = with_constraint(0.0, 4.0)
    by_channel = np.zeros((10, MAX_SCALARS))
    by_channel[:, CH_NHC] = 1.0
    acting = replace(linear.layout[0], direct=Direct(by_channel)).in_layout()
    found = evidence(conditional(replace(linear, layout=(acting,)), Given()), (0,))
    assert found.nats > 15.0


def test_what_the_constraint_alone_says_is_no_sign_of_something_missing() -> None:
    swaying = strongest_by_chance(conditional(with_constraint(0.0, 4.0), Given()), [(0,)], 2000)
    missing = strongest_by_chance(conditional(with_constraint(4.0, 4.0), Given()), [(0,)], 2000)
    assert swaying is not None
    assert missing is not None
    assert swaying.p_value > 0.1 > limits.SUSPECTED >= missing.p_value


def test_scores_that_are_all_too_large_tell_by_how_much() -> None:
    columns = np.arange(60)
    quiet = inflation(conditional(drive(np.zeros(60)), Given()), columns)
    loud = inflation(conditional(drive(np.zeros(60), noise=2.0), Given()), columns)
    assert 1.0 <= quiet < 1.6
    assert loud == pytest.approx(4.0, rel=0.4)
    # one that is really there hides nothing and raises little
    some = inflation(conditional(drive(np.array([3.0] + [0.0] * 59)), Given()), columns)
    assert some < 1.6


def test_inflated_scores_lower_evidence() -> None:
    known = conditional(drive(np.array([2.0])), Given())
    plain, lowered = evidence(known, (0,)), evidence(known, (0,), 4.0)
    assert lowered.overdispersion == 4.0
    assert lowered.nats == pytest.approx(plain.uncorrected - 0.75 * plain.fixed)


@pytest.mark.parametrize("apart", [0.0, 0.5])
def test_channels_that_contradict_one_another_widen_what_they_say(apart: float) -> None:
    rng = np.random.default_rng(3)
    phi = rng.standard_normal((1200, 1))
    channel = np.arange(len(phi)) % 3
    # one of three says something else
    theta = 1.0 + apart * (channel == 2)
    linear = linear_of(phi, theta * phi[:, 0] + rng.standard_normal(len(phi)), columns_named("a.x"))
    rows = replace(linear.rows[0], channel=channel)
    known = conditional(replace(linear, rows=(rows,)), Given())
    ratio = between_channels(known, (0,), 1.2)
    # of two degrees of freedom, 400 rows a channel
    expected = apart**2 * 400.0 * (2.0 / 3.0) / 2.0
    assert ratio == pytest.approx(max(1.2, expected), rel=0.5) if apart else ratio == 1.2
