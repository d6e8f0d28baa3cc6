"""Small formulas of the clock's estimate against brute force and against what they must not see."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from automap.sync import correlation, limits
from automap.sync.envelope import bin_quantiles, lower_envelope, quantile_line
from automap.sync.held_values import frozen_positions, repeated
from automap.sync.path_match import Estimate
from automap.sync.receiver_path import ReceiverPath
from automap.sync.unit_mistakes import MISTAKES, unit_mistake


def test_runs_of_repeats_are_those_that_a_walk_along_the_rows_finds() -> None:
    rng = np.random.default_rng(0)
    for share in (0.0, 0.3, 0.8, 1.0):
        same = rng.random(60) < share
        wanted = []
        for value, group in itertools.groupby(enumerate(same), key=lambda pair: bool(pair[1])):
            rows = [row for row, _ in group]
            if value:
                # row k of ``same`` compares rows k and k + 1
                wanted.append((rows[0], rows[-1] + 1))
        assert repeated(same) == wanted


@pytest.mark.parametrize(("worse", "jump", "held"), [(1.0, 40.0, 1), (9.0, 40.0, 0), (1.0, 6.0, 0)])
def test_rows_that_stand_are_held_where_what_follows_jumps_by_more_than_this_receiver_errs(
    worse: float, jump: float, held: int
) -> None:
    """A car rolls to a halt, its rows repeat, and it goes on from where it was, or elsewhere."""
    t = np.arange(0.0, 60.0, 0.5)
    speed = np.where((t > 20.0) & (t < 40.0), 0.0, np.minimum(1.5, np.abs(t - 30.0) * 0.1 - 1.0))
    right = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * 0.5)]) + 0j
    place = right + np.where(t >= 40.0, jump, 0.0)
    none = np.zeros(len(t))
    path = ReceiverPath(np.arange(len(t)), t, 0.0, place, speed + 0j, none, none, none)
    positions, both = frozen_positions(path, right, path.velocity, worse)
    assert (positions, len(both)) == ([], held)
    if held:
        assert both[0].metres == pytest.approx(jump)


@pytest.mark.parametrize(("curvature", "found"), [(0.3, True), (0.0, False)])
def test_a_lag_is_where_scores_have_a_top_however_flat(
    curvature: float, found: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Channel:
        """Scores of a known parabola, in place of motions."""

        target = np.zeros(7)

        def scores(self, lags: np.ndarray) -> np.ndarray:
            edge = 1e-9 * np.abs(lags - 0.1)
            return curvature * (lags - 0.1) ** 2 + (edge if curvature else 0.0 * lags)

        def reweight(self, lag: float) -> None:
            assert abs(lag) <= 1.0

        def sandwich(self, lag: float, step: float) -> tuple[float, float]:
            return 4.0, 9.0

    monkeypatch.setattr(correlation, "channels_between", lambda *_: [Channel()])
    motion = correlation.ImuMotion(np.arange(3.0), np.zeros((3, 6)))
    fixes = correlation.GnssMotion(*[np.zeros(3)] * 5)
    lag = correlation.refine_lag(motion, fixes, 0.0, 1.0)
    assert (lag is not None) == found
    if lag is not None:
        assert lag.lag_s == pytest.approx(0.1, abs=1e-6)
        assert lag.sd_s == pytest.approx(np.hypot(3.0 / 4.0, limits.MODEL_SD_S))
        assert lag.intervals == 7


@pytest.mark.parametrize("n", [7, 40, 900])
def test_bins_have_the_quantiles_of_their_points(n: int) -> None:
    rng = np.random.default_rng(n)
    x, y = rng.random(n), rng.normal(size=n)
    bin_x, bin_y = bin_quantiles(x, y, 0.3, most=12)
    parts = np.array_split(np.argsort(x), max(1, min(12, n // 5)))
    assert bin_x == pytest.approx([x[part].mean() for part in parts])
    assert bin_y == pytest.approx([np.quantile(y[part], 0.3) for part in parts])
    # points of one x are one bin
    assert len(bin_quantiles(np.ones(n), y, 0.3)[0]) == 1


def test_a_quantile_line_is_the_best_of_all_through_two_bins() -> None:
    rng = np.random.default_rng(4)
    x = rng.uniform(0.0, 100.0, 200)
    y = 3.0 - 0.02 * x + rng.exponential(1.0, 200)
    start, slope = quantile_line(x, y, 0.2)
    bins = np.column_stack(bin_quantiles(x, y, 0.2))

    def cost(start: float, slope: float) -> float:
        over = bins[:, 1] - start - slope * bins[:, 0]
        return float(
            limits.RAISED_WEIGHT * over[over > 0.0].sum()
            - (1.0 - limits.RAISED_WEIGHT) * over[over < 0.0].sum()
        )

    lines = []
    for (x1, y1), (x2, y2) in itertools.combinations(bins.tolist(), 2):
        rise = (y2 - y1) / (x2 - x1)
        lines.append((y1 - rise * x1, rise))
    best = min(lines, key=lambda line: cost(*line))
    assert (start, slope) == pytest.approx(best)
    # moved and stretched points have a line moved and stretched
    assert quantile_line(x, 5.0 + 2.0 * y, 0.2) == pytest.approx((5.0 + 2.0 * start, 2.0 * slope))
    assert quantile_line(np.ones(9), y[:9], 0.2) == (pytest.approx(np.quantile(y[:9], 0.2)), 0.0)


def test_the_edge_of_delays_is_found_to_its_sigma() -> None:
    """Over a dozen logs of exponential waiting: errors of intercept and slope are about as large as
    their sigmas, and the edge moves with the points."""
    rng = np.random.default_rng(8)
    errors = []
    for number in range(12):
        x = np.sort(rng.uniform(0.0, 300.0, 150))
        edge = 0.05 + 2e-5 * (x - x.mean())
        y = edge + rng.exponential(0.004, len(x))
        found = lower_envelope(x, y, 1e-4)
        miss = np.array([found.intercept - 0.05, found.slope - 2e-5])
        errors.append(miss / np.sqrt(np.diag(found.covariance)))
        assert found.at(np.array([found.x_ref + 10.0])) == pytest.approx(
            [found.intercept + 10.0 * found.slope]
        )
        if number == 0:
            shifted = lower_envelope(x + 1000.0, y + 7.0, 1e-4)
            assert shifted.intercept == pytest.approx(found.intercept + 7.0, abs=1e-9)
            assert shifted.x_ref == pytest.approx(found.x_ref + 1000.0)
    # a root mean square of twelve is known to a fifth: four fifths on either side of one
    spread = np.sqrt(np.mean(np.square(errors), axis=0))
    assert np.all(spread > 0.2)
    assert np.all(spread < 1.8)


def test_a_scale_is_a_units_only_where_it_is_wrong_beyond_doubt() -> None:
    knots = next(m for m in MISTAKES if (m.logged, m.expected) == ("knots", "m/s"))
    assert unit_mistake(Estimate(knots.factor, 0.02)) == (knots, True)
    # near a unit's, but as near to a sound receiver's; and far from all
    assert unit_mistake(Estimate(1.0 + 0.6 * (knots.factor - 1.0), 0.3)) == (None, False)
    assert unit_mistake(Estimate(1.0, 0.01)) == (None, False)
    odd = 1.4142 * max(m.factor for m in MISTAKES)
    assert unit_mistake(Estimate(odd, 0.001 * odd)) == (None, True)
    assert unit_mistake(None) == (None, False)
