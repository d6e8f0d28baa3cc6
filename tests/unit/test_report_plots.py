"""The plots of the report and the words beside them."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree

from automap.gates import mean_square_limits
from pipeline.pages.svg_plot import (
    BOTTOM,
    HEIGHT,
    LEFT,
    LINE_ROWS,
    RIGHT,
    TOP,
    WIDTH,
    Series,
    plot,
    thin_dots,
    thin_line,
    tick_label,
    ticks,
    time_unit,
)
from pipeline.report.nis_plots import nis_series
from pipeline.report.sections import innovation_verdict

finite = st.floats(-1e9, 1e9)


@given(finite, st.floats(1e-9, 1e9))
def test_ticks_are_few_round_and_inside(low: float, span: float) -> None:
    high = low + span
    # below this the steps drown in rounding
    if span < 1e-6 * abs(low):
        return
    values = ticks(low, high)
    assert 2 <= len(values) <= 9
    slack = 1e-9 * (abs(low) + span)
    assert values[0] >= low - slack
    assert values[-1] <= high + slack
    step = values[1] - values[0]
    assert round(step / 10.0 ** np.floor(np.log10(step * 1.0001))) in (1, 2, 5, 10)


@given(finite, st.floats(1e-7, 1e9))
def test_tick_labels_tell_neighbours_apart(low: float, span: float) -> None:
    if span < 1e-6 * abs(low):
        return
    values = ticks(low, low + span)
    step = float(values[1] - values[0])
    labels = [tick_label(float(value), step) for value in values]
    assert len(set(labels)) == len(labels)


def points(svg: str, css: str) -> np.ndarray:
    (path,) = re.findall(rf'<path class="{css}[^"]*" d="([^"]*)"', svg)
    return np.array([[float(v) for v in p.split()] for p in re.findall(r"[\d.]+ [\d.]+", path)])


def test_a_long_series_keeps_its_extremes_and_stays_small() -> None:
    x = np.arange(1_000_000) * 0.01
    y = np.sin(x / 500.0)
    y[123_456] = 7.0
    y[777_777] = -5.0
    svg = plot([Series("a", x, y)], "t", "m", "s")
    assert len(svg) < 40_000
    drawn = points(svg, "l ")[:, 1]
    short = plot([Series("a", x[[0, 123_456, 777_777, -1]], y[[0, 123_456, 777_777, -1]])],
                 "t", "m", "s")  # fmt: skip
    expected = points(short, "l ")[:, 1]
    assert drawn.min() == expected.min()
    assert drawn.max() == expected.max()


@given(st.lists(st.tuples(finite, finite), min_size=1, max_size=40), st.booleans())
def test_everything_lies_inside_the_frame(rows: list[tuple[float, float]], log: bool) -> None:
    x, y = np.array(sorted(rows)).T
    svg = plot([Series("a", x, y, "dots")], "t", "m", "s", log=log)
    etree.fromstring(svg)
    drawn = points(svg, "d ")
    assert ((drawn[:, 0] >= LEFT - 0.1) & (drawn[:, 0] <= WIDTH - RIGHT + 0.1)).all()
    assert ((drawn[:, 1] >= TOP - 0.1) & (drawn[:, 1] <= HEIGHT - BOTTOM + 0.1)).all()


def test_holes_in_a_series_stay_open() -> None:
    x = np.concatenate([np.arange(0, 100.0), np.arange(500, 600.0)])
    svg = plot([Series("a", x, np.ones(200))], "t", "m", "s")
    (path,) = re.findall(r'class="l [^"]*" d="([^"]*)"', svg)
    assert path.count("M") == 2


def test_nothing_to_draw_gives_no_plot_and_hostile_text_is_escaped() -> None:
    nan = np.full(4, np.nan)
    assert plot([Series("a", np.arange(4.0), nan)], "t", "m", "s") == ""
    assert plot([], "t", "m", "s") == ""
    svg = plot([Series("a", np.arange(4.0), np.arange(4.0))], '<b>"x"', "<i>", "&")
    assert etree.fromstring(svg).findtext("title") == '<b>"x"'


def test_thinning_and_units() -> None:
    assert len(thin_dots(10_001, 1000)) <= 1000
    assert thin_dots(5, 10).tolist() == [0, 1, 2, 3, 4]
    assert [time_unit(s)[1] for s in (30.0, 1000.0, 20_000.0)] == ["s", "min", "h"]


@pytest.mark.parametrize(
    ("rms", "mean", "accepted", "words"),
    [
        (1.0, 0.0, 1.0, "as expected"),
        (1.1, 0.1, 0.97, "as expected"),
        (2.0, 0.0, 1.0, "too small"),
        (0.3, 0.0, 1.0, "cautious"),
        (1.0, 0.6, 1.0, "one side"),
        (1.0, 0.0, 0.7, "30%"),
    ],
)
def test_verdict_on_innovations(rms: float, mean: float, accepted: float, words: str) -> None:
    assert words in innovation_verdict(rms, mean, accepted)


@pytest.mark.parametrize("common", [True, False])
def test_nis_lies_in_the_band_of_chance_and_leaves_it_when_sigmas_are_wrong(common: bool) -> None:
    rng = np.random.default_rng(8)
    epochs = 1500
    t_ns = np.repeat(np.arange(epochs) * 200_000_000, 3)
    channels = np.array(["position_n", "position_e", "position_d"] * epochs, object)
    accepted = np.ones(len(t_ns), bool)
    nis = rng.normal(0, 1, len(t_ns)) ** 2
    if common:
        # the rows of one measurement carry its NIS of three degrees of freedom
        nis = np.repeat(nis.reshape(-1, 3).sum(axis=1), 3)
    ((title, (band, mean)),) = nis_series(channels, t_ns, nis, accepted)
    assert "GPS position" in title
    assert np.mean(mean.y) == pytest.approx(1.0, abs=0.1)
    inside = (mean.y > band.y) & (mean.y < band.upper)
    assert 0.85 < inside.mean() <= 1.0
    ((_, (band, mean)),) = nis_series(channels, t_ns, 4 * nis, accepted)
    assert not ((mean.y > band.y) & (mean.y < band.upper)).any()
    assert nis_series(channels, t_ns, nis, ~accepted) == []
    assert nis_series(channels[:3], t_ns[:3], nis[:3], accepted[:3]) == []


def test_limits_of_chance_are_those_of_chi_square() -> None:
    from scipy.stats import chi2

    count = np.array([6.0, 50.0, 400.0])
    low, high = mean_square_limits(count)
    np.testing.assert_allclose(low, chi2.ppf(0.025, count) / count, rtol=1e-9)
    np.testing.assert_allclose(high, chi2.ppf(0.975, count) / count, rtol=1e-9)


def test_a_very_long_line_is_drawn_as_all_its_rows_would_be() -> None:
    rng = np.random.default_rng(4)
    n = 3 * LINE_ROWS + 17
    y = rng.standard_normal(n)
    y[[0, 123_456, n - 1]] = np.nan, 40.0, -30.0
    whole = Series("", np.asarray(np.arange(n) * 0.01, np.float64), y)
    thin = thin_line(whole)
    assert len(thin.x) < 1.1 * LINE_ROWS
    assert (np.diff(thin.x) > 0.0).all()
    assert (np.nanmin(thin.y), np.nanmax(thin.y)) == (-30.0, 40.0)
    ours, theirs = (points(plot([s], "t", "y", "x"), "l ") for s in (thin, whole))
    # a few rows at the edge of a pixel column count with its neighbour
    assert ours.shape == theirs.shape
    assert np.abs(ours - theirs).max() < 10.0
    assert np.mean(np.abs(ours - theirs)) < 0.2
    assert thin_line(thin) is thin
