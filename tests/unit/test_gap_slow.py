"""Courses of time through boxes: which are tried, found and refined."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest

from automap.effects.formula_text import parse_formula
from automap.effects.user import INERTIAL as CHANNELS
from automap.gap import limits
from automap.gap.candidates import follows_time, is_course
from automap.gap.columns import size_of
from automap.gap.evidence import plain_nats
from automap.gap.linear import Column, Given, Linear, conditional
from automap.gap.result import equation
from automap.gap.rows import Rows
from automap.gap.slow import (
    NUMBER,
    PLATEAU,
    SEAT,
    _time_signals,
    box_s,
    gain_step_s,
    lasts,
    plateaus,
    shapes,
    switched,
    variants,
    with_shapes,
)
from automap.records import FloatArray

LENGTH_S = 400.0
WIDTH_S = limits.BOX_S
TIMES = np.arange(0.5 * WIDTH_S, LENGTH_S, WIDTH_S)
INFO = 400.0


def instants(text: str) -> list[float]:
    return [float(x) for x in re.findall(r"step\(time - ([\d.]+)\)", text)]


def curve(text: str, t: FloatArray = TIMES) -> FloatArray:
    return parse_formula(text)(_time_signals(t))


def told(values: FloatArray, seed: int = 1) -> tuple[FloatArray, FloatArray]:
    """Score and information of boxes along which a bias has these values."""
    noise = np.sqrt(INFO) * np.random.default_rng(seed).standard_normal(len(TIMES))
    return INFO * values + noise, INFO * np.eye(len(TIMES))


@pytest.mark.parametrize(("begin", "end"), [(100.0, 160.0), (210.0, 380.0), (20.0, 45.0)])
def test_the_likeliest_plateau_is_the_one_that_is_there(begin: float, end: float) -> None:
    inside = (begin < TIMES) & (end > TIMES)
    best = plateaus(TIMES, *told(np.where(inside, 1.0, 0.0)))
    assert len(best) == limits.PLATEAUS
    assert instants(best[0].texts[0]) == pytest.approx([begin, end], abs=WIDTH_S)
    # one in so many pairs of instants
    assert all(shape.choices > 100.0 for shape in best)
    np.testing.assert_allclose(curve(best[0].texts[0]) > 0.5, inside)
    # the others are no neighbours of it
    ends = [instants(shape.texts[0]) for shape in best]
    for i, (a, b) in enumerate(ends):
        assert all(abs(a - c) + abs(b - d) > 0.5 * (b - a) for c, d in ends[:i])


def test_two_plateaus_are_both_found() -> None:
    first, second = (TIMES > 60.0) & (TIMES < 100.0), (TIMES > 250.0) & (TIMES < 300.0)
    best = plateaus(TIMES, *told(1.2 * first - 1.0 * second))
    found = [instants(shape.texts[0]) for shape in best]
    assert any(one == pytest.approx([60.0, 100.0], abs=WIDTH_S) for one in found)
    assert any(one == pytest.approx([250.0, 300.0], abs=WIDTH_S) for one in found)


def test_what_begins_or_ends_with_the_drive_is_no_plateau() -> None:
    best = plateaus(TIMES, *told(np.where(TIMES < 150.0, 1.0, 0.0)))
    for begin, end in (instants(shape.texts[0]) for shape in best):
        assert TIMES[0] < begin < end < TIMES[-1]
    assert plateaus(TIMES[:3], np.ones(3), np.eye(3)) == []


def test_boxes_may_come_in_any_order() -> None:
    score, info = told(np.where((TIMES > 100.0) & (TIMES < 160.0), 1.0, 0.0))
    order = np.random.default_rng(2).permutation(len(TIMES))
    mixed = plateaus(TIMES[order], score[order], info[np.ix_(order, order)])
    assert mixed == plateaus(TIMES, score, info)


def explained(values: FloatArray, texts: tuple[str, ...], t: FloatArray = TIMES) -> float:
    """Share of a curve that others make up."""
    columns = np.stack([curve(text, t) for text in texts], axis=1)
    left = values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
    return 1.0 - float(left @ left) / float(values @ values)


def test_every_course_of_a_drive_is_near_one_that_is_tried() -> None:
    every = shapes(0.0, LENGTH_S)
    rng = np.random.default_rng(3)
    t = np.arange(0.0, LENGTH_S, 0.5)

    def nearest(values: FloatArray, word: str) -> float:
        return max(explained(values, s.texts, t) for s in every if word in s.texts[0])

    for period in np.geomspace(1.1 * limits.LEAST_BOXES * box_s(LENGTH_S), 0.7 * LENGTH_S, 25):
        phase = rng.uniform(0.0, 2.0 * np.pi)
        # halfway between two frequencies sinc(1 / 3)^2 of the power is left
        assert nearest(np.sin(2.0 * np.pi * t / period + phase), "sin") > 0.64
    for tau in rng.uniform(12.0, 190.0, 10):
        assert nearest(np.exp(-t / tau), "exp") > 0.97
    for at in rng.uniform(20.0, LENGTH_S - 20.0, 10):
        step = np.where(t > at, 1.0, 0.0)
        tried = [s for s in every if s.texts[0].startswith("step")]
        assert min(abs(instants(s.texts[0])[0] - at) for s in tried) <= 0.5 * box_s(LENGTH_S) + 1e-6
        assert nearest(step, "step") > 0.8


def test_no_course_is_tried_twice_and_long_drives_have_no_more_of_them() -> None:
    counts = []
    for length in (120.0, 600.0, 3600.0, 20000.0):
        texts = [s.texts for s in shapes(0.0, length)]
        assert len(set(texts)) == len(texts)
        counts.append(len(texts))
    assert counts[0] < counts[1]
    assert counts[3] <= counts[2] + 1
    assert box_s(60.0) == limits.BOX_S
    assert box_s(3600.0) == pytest.approx(3600.0 / limits.MOST_BOXES)


@pytest.mark.parametrize(
    ("texts", "true"),
    [
        (("step(time - 200)",), "step(time - 202)"),
        (("exp(-time / 40)",), "exp(-time / 44)"),
        (("sin(2 * pi * time / 50)", "cos(2 * pi * time / 50)"), "cos(2 * pi * time / 51.5)"),
        (("step(time - 100) - step(time - 160)",), "step(time - 103) - step(time - 158)"),
    ],
)
def test_a_course_is_refined_between_those_that_were_tried(
    texts: tuple[str, ...], true: str
) -> None:
    terms = tuple(("gyro_z", text) for text in texts)
    assert is_course(terms)
    tried = variants(terms, LENGTH_S)
    assert len(tried) > 10
    t = np.arange(0.0, LENGTH_S, 0.25)
    values = curve(true, t)
    before = explained(values, texts, t)
    finest = max(tried, key=lambda one: explained(values, tuple(x for _, x in one), t))
    after = explained(values, tuple(x for _, x in finest), t)
    assert 1.0 - after < 0.25 * (1.0 - before)
    # all terms of one course keep one period, each its own channel
    for one in tried:
        assert [on for on, _ in one] == ["gyro_z"] * len(texts)
        assert len({x[4:] for _, x in one if x[3] == "("}) <= 1


@pytest.mark.parametrize("gain", ["", "rate_z * "])
def test_what_is_on_for_a_part_of_each_period_is_found_from_what_swings(gain: str) -> None:
    t = np.arange(0.0, LENGTH_S, 0.25)
    values = np.where((t - 7.0) % 82.0 < 26.0, 1.0, 0.0)
    best: tuple[tuple[str, str], ...] = tuple(
        ("gyro_z", f"{gain}{wave}(2 * pi * time / 82.8)") for wave in ("sin", "cos")
    )

    def share(terms: tuple[tuple[str, str], ...]) -> float:
        texts = tuple(text.removeprefix(gain) for _, text in terms)
        # beside a constant, which a bias says
        columns = np.stack([curve("1 + 0 * time", t), *(curve(x, t) for x in texts)], axis=1)
        left = values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
        return 1.0 - float(left.var() / values.var())

    swings = share(best)
    for _ in range(2):
        waves = switched(best)
        assert 10 < len(waves) < 130
        assert all(follows_time(one) for one in waves)
        best = max(waves, key=share)
    assert swings < 0.8
    assert share(best) > 0.94
    assert switched([("gyro_z", "speed")]) == switched([("gyro_z", "step(time - 3)")]) == []


def test_a_plateau_of_a_moment_does_not_last() -> None:
    least = limits.LEAST_BOXES * box_s(LENGTH_S)

    def plateau(seconds: float) -> list[tuple[str, str]]:
        return [("accel_x", PLATEAU.format(100.0, 100.0 + seconds))]

    assert lasts(plateau(1.1 * least), LENGTH_S)
    assert not lasts(plateau(0.9 * least), LENGTH_S)
    for text in ("step(time - 3)", "exp(-time / 2)", "speed"):
        assert lasts([("accel_x", text)], LENGTH_S)


def test_what_is_no_course_of_time_is_not_refined() -> None:
    for text in ("speed", "tanh(rate_z / 0.01)", "time^2", "force_x * speed"):
        assert not is_course([("gyro_z", text)])
    assert not is_course([])
    assert not is_course([("gyro_z", "exp(-time / 40)"), ("gyro_z", "speed")])
    assert variants([("gyro_z", "speed")], LENGTH_S) == []


ROWS_A_BOX = 4


@lru_cache
def boxes(course: str, on: str, channels: tuple[str, ...] = CHANNELS) -> Linear:
    """A drive that was made linear in boxes of channels, with a course of time of usual size on one
    of them, and a column that is none."""
    layout = [Column("gyro_scale", "z", 0.01)]
    layout += [
        Column("box drive", f"{c} {t:.3f}", size_of(c), term=(c, f"{t:.3f}"))
        for t in TIMES
        for c in channels
    ]
    rng = np.random.default_rng(6)
    phi = np.zeros((ROWS_A_BOX * (len(layout) - 1), len(layout)))
    phi[:, 0] = 10.0 * rng.standard_normal(len(phi))
    for i, column in enumerate(layout[1:], 1):
        at = slice(ROWS_A_BOX * (i - 1), ROWS_A_BOX * i)
        phi[at, i] = 4.0 / size_of(column.term[0])
    acts = phi[:, [c.term[0] == on for c in layout]]
    w = acts @ (size_of(on) * curve(course)) + rng.standard_normal(len(phi))
    t = np.repeat(TIMES, ROWS_A_BOX * len(channels))
    rows = Rows(w, phi, t, np.zeros(len(t), np.int64))
    sds = np.array([c.prior_sd for c in layout])
    score, info = phi.T @ w, phi.T @ phi
    return Linear(tuple(layout), (rows,), None, score, info, sds, np.zeros(len(layout)))


@pytest.mark.parametrize(
    ("course", "on", "word"),
    [
        ("sin(2 * pi * time / 60)", "gyro_z", "sin"),
        ("step(time - 200)", "accel_x", "step"),
        ("exp(-time / 25)", "gyro_z", "exp"),
        ("step(time - 100) - step(time - 160)", "accel_x", "- step"),
    ],
)
def test_a_course_of_time_stands_out_of_its_boxes(course: str, on: str, word: str) -> None:
    linear = with_shapes(boxes(course, on))
    assert not any(c.effect.startswith("box") for c in linear.layout)
    assert linear.layout[0].effect == "gyro_scale"
    parts: dict[str, list[int]] = {}
    for i, column in enumerate(linear.layout):
        parts.setdefault(column.effect, []).append(i)
    known = conditional(linear, Given())
    nats = {name: plain_nats(known, tuple(part))[0] for name, part in parts.items()}
    best = max(nats, key=lambda name: nats[name])
    channel, text = linear.layout[parts[best][0]].term
    assert channel == on
    assert word in text
    assert nats[best] > 50.0
    assert best == equation([linear.layout[i].term for i in parts[best]])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("course", "on"),
    [
        ("max(time - 150, 0) / 60", "imu_time"),
        ("exp(-time / 60)", "imu_yaw"),
    ],
)
def test_a_seat_that_changes_stands_out_of_its_boxes(course: str, on: str) -> None:
    linear = with_shapes(boxes(course, on, (*CHANNELS, *SEAT)))
    parts: dict[str, list[int]] = {}
    for i, column in enumerate(linear.layout):
        parts.setdefault(column.effect, []).append(i)
    known = conditional(linear, Given())
    nats = {name: plain_nats(known, tuple(part))[0] for name, part in parts.items()}
    best = max(nats, key=lambda name: nats[name])
    terms = [linear.layout[i].term for i in parts[best]]
    assert terms[0][0] == on
    assert terms[0][1].startswith(course[:4])
    assert nats[best] > 50.0
    # what lasts for a moment is usually no larger than what stays
    largest = np.abs(curve(terms[0][1])).max()
    assert linear.prior_sd[parts[best][0]] * largest == pytest.approx(size_of(on))
    # its instant, time constant or period is refined as far as the next that was tried
    assert is_course(terms)
    finer = variants(terms, LENGTH_S)
    assert len(finer) > 10
    ends = [float(NUMBER.findall(one[0][1])[-1]) for one in finer]
    own = float(NUMBER.findall(terms[0][1])[-1])
    if terms[0][1].startswith(("step", "max")):
        assert max(ends) - own == pytest.approx(gain_step_s(LENGTH_S), rel=1e-3)


def turning(linear: Linear, swing: FloatArray) -> Linear:
    """The same drive with turns, whose rates the gyro tells by ``swing`` [n] of them too large."""
    rates = np.tile(0.2 * np.sin(np.arange(len(TIMES))), (len(CHANNELS), 1)).T.ravel()
    layout = [
        replace(c, mean_input=0.0 if i == 0 else float(rates[i - 1]))
        for i, c in enumerate(linear.layout)
    ]
    acts = linear.rows[0].phi[:, [c.term[0] == "gyro_z" for c in layout]]
    w = linear.rows[0].w + acts @ (rates[:: len(CHANNELS)] * swing)
    rows = replace(linear.rows[0], w=w)
    return replace(linear, layout=tuple(layout), rows=(rows,), score=rows.phi.T @ w)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("swing", "word"), [("sin(2 * pi * time / 75)", "sin"), ("step(time - 210)", "step")]
)
def test_a_gain_that_changes_stands_out_of_the_boxes(swing: str, word: str) -> None:
    nothing = boxes("0 * time", "gyro_z")
    linear = with_shapes(turning(nothing, 0.01 * curve(swing)))
    parts: dict[str, list[int]] = {}
    for i, column in enumerate(linear.layout):
        parts.setdefault(column.effect, []).append(i)
    known = conditional(linear, Given())
    nats = {name: plain_nats(known, tuple(part))[0] for name, part in parts.items()}
    best = max(nats, key=lambda name: nats[name])
    terms = [linear.layout[i].term for i in parts[best]]
    assert terms[0][0] == "gyro_z"
    assert terms[0][1].startswith(f"rate_z * {word}")
    assert nats[best] > 20.0
    assert follows_time(terms)
    assert not is_course(terms)
    # its period or instant is refined as that of a bias is
    finer = variants(terms, LENGTH_S)
    assert len(finer) > 10
    assert all(text.startswith("rate_z * ") for one in finer for _, text in one)


def test_a_car_that_never_turns_shows_no_gain() -> None:
    linear = with_shapes(boxes("0 * time", "gyro_z"))
    assert not any(c.term[1].startswith("rate_z") for c in linear.layout)


@pytest.mark.slow
def test_courses_have_score_and_information_of_their_rows() -> None:
    linear = with_shapes(turning(boxes("step(time - 200)", "gyro_z"), 0.0 * TIMES))
    (rows,) = linear.rows
    phi = linear.columns(rows, range(len(linear.layout)))
    np.testing.assert_allclose(linear.score, phi.T @ rows.w, rtol=1e-6, atol=1e-6)
    scale = np.sqrt(np.outer(linear.sizes, linear.sizes))
    every = np.arange(len(linear.layout))
    np.testing.assert_allclose((linear.cross(every) - phi.T @ phi) / scale, 0.0, atol=1e-9)
    np.testing.assert_allclose(linear.sizes, np.diag(phi.T @ phi), rtol=1e-9)
    # of one channel, and of two
    parts = np.stack([every[:-1], every[1:]], axis=1)
    size = scale[parts[:, 0], parts[:, 1], None, None]
    whole = (phi.T @ phi)[parts[:, :, None], parts[:, None, :]] / size
    found = linear.pairs(parts) / size
    np.testing.assert_allclose(found, whole, atol=1e-9)
    # a parameter's prior is that of the size of what it adds
    at = next(i for i, c in enumerate(linear.layout) if c.term[1].startswith("exp"))
    rises = curve(linear.layout[at].term[1])
    assert linear.prior_sd[at] * np.std(rises) == pytest.approx(size_of(linear.layout[at].term[0]))


def test_a_course_that_is_in_the_model_is_not_tried_beside_itself() -> None:
    plain = boxes("step(time - 200)", "gyro_z")
    text = next(s.texts[0] for s in shapes(TIMES[0], TIMES[-1]) if s.texts[0].startswith("exp"))
    name = equation([("gyro_z", text)])
    layout = (Column(name, "k", 1.0, term=("gyro_z", text)), *plain.layout[1:])
    known = with_shapes(replace(plain, layout=layout))
    names = [c.effect for c in known.layout]
    assert names.count(name) == 1
    assert equation([("accel_x", text)]) in names


def test_without_boxes_nothing_changes() -> None:
    plain = boxes("step(time - 200)", "gyro_z")
    bare = replace(plain, layout=plain.layout[:1])
    assert with_shapes(bare) is bare


def test_refinements_reach_as_far_as_the_next_that_was_tried() -> None:
    every = [s.texts[0] for s in shapes(0.0, LENGTH_S)]
    for word in ("sin", "exp", "step"):
        tried = [text for text in every if text.startswith(word)]
        for one, other in pairwise(tried):
            finer = [terms[0][1] for terms in variants((("gyro_x", one),), LENGTH_S)]
            ends = sorted(float(re.findall(r"[\d.]+(?=\)$)", x)[0]) for x in finer)
            there = float(re.findall(r"[\d.]+(?=\)$)", other)[0])
            assert 0.98 * ends[0] <= there <= 1.02 * ends[-1]
