"""Single steps of longer computations, each by itself: what goes in, what comes out of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from automap.effects.measured_kernels import vehicle_velocity
from automap.effects.navigation import N_NAV
from automap.effects.term_sums import SIGNAL_COLUMN, SIGNAL_ONE, TIME, TURN, new_room, set_signals
from automap.errors import InputError
from automap.frames import rotation_vector_to_matrix
from automap.fusion import adapt, engine, preparation
from automap.fusion.layout import HAS_POS_H
from automap.fusion.level_likelihood import LevelLikelihood
from automap.fusion.levels import ALL_LEVELS, VELOCITY_TAU, VELOCITY_WANDER
from automap.fusion.limits import (
    ABSENT,
    FIX_EDGE_S,
    LASTING_ODDS_NATS,
    LEAST_FIXES,
    LEVEL_SPREAD,
)
from automap.gap.joint import combine
from automap.records import FloatArray
from automap.sync import held_values, limits, steps
from automap.sync.held_values import _jump_after, in_long_repeats, stuck_velocities
from automap.sync.receiver_path import ComplexArray
from automap.sync.steps import find_step


@pytest.mark.parametrize("late_s", [0.0, 0.4])
def test_what_wheels_tell_late_is_gained_as_the_vehicles_axes_turn(late_s: float) -> None:
    """Against numeric derivatives of the velocity in vehicle axes along a motion of constant
    acceleration and turn, where the mounting is turned about all axes."""
    rng = np.random.default_rng(1)
    C, a, w = rotation_vector_to_matrix(rng.normal(size=3)), *rng.normal(size=(2, 3))
    v = 8.0 * rng.normal(size=3)
    codes = np.array([[0, TIME, 0, SIGNAL_ONE], *([1 + k, TURN, k, SIGNAL_ONE] for k in range(3))])
    xi = np.array([late_s, 0.3, -0.4, 0.5])
    h, out, now = np.zeros((3, N_NAV + 4)), np.zeros(3), np.zeros(SIGNAL_COLUMN)
    set_signals(now, 0.0, np.zeros(0))
    room = new_room()
    vehicle_velocity(h, out, v, C, w, a, xi, codes, np.ones(4), now, room)
    W = room[7:10].copy()
    np.testing.assert_allclose(W @ W.T, np.eye(3), atol=1e-12)

    def at(t: float) -> FloatArray:
        return np.asarray(W @ (C @ rotation_vector_to_matrix(w * t)).T @ (v + a * t))

    slope = (at(1e-5) - at(-1e-5)) / 2e-5
    np.testing.assert_allclose(out, at(0.0) + np.array([late_s * slope[0], 0.0, 0.0]), atol=1e-6)
    np.testing.assert_allclose(h[:, N_NAV], [slope[0], 0.0, 0.0], atol=1e-6)


@pytest.mark.parametrize("p", [0, 3])
def test_drives_joined_are_their_information_added_and_the_prior_counted_once(p: int) -> None:
    """Evidence and estimate in closed form: each drive's likelihood is its posterior over its
    prior, as a normal distribution."""
    rng = np.random.default_rng(2)
    sd = np.array([0.5, 2.0, 1.0])[:p]
    names = tuple(("e", str(k)) for k in range(p))
    fits, gains = [], [0.7, -1.1]
    N, g = np.diag(sd**-2.0), np.zeros(p)
    nats: Any = 0.0
    for gain in gains:
        root = rng.normal(size=(p, p + 1))
        told = root @ root.T
        own = np.linalg.inv(told + np.diag(sd**-2.0))
        mean = own @ rng.normal(size=p)
        fits.append(SimpleNamespace(names=names, cov=own, values=mean))
        N, g = N + told, g + np.linalg.inv(own) @ mean
        # the factor of the evidence that the drive's data have, apart from the estimate
        nats += gain - 0.5 * mean @ np.linalg.inv(own) @ mean
        nats += 0.5 * np.linalg.slogdet(np.linalg.inv(own) * np.outer(sd, sd))[1]
    found = combine(fits, gains, sd)  # type: ignore[arg-type]
    assert found.values.shape == (p,)
    assert found.cov.shape == (p, p)
    value = np.linalg.solve(N, g)
    np.testing.assert_allclose(found.values, value, rtol=1e-6)
    np.testing.assert_allclose(found.cov, np.linalg.inv(N), rtol=1e-6, atol=1e-9)
    nats += 0.5 * g @ value - 0.5 * np.linalg.slogdet(N * np.outer(sd, sd))[1]
    assert found.nats == pytest.approx(nats, rel=1e-6)
    assert list(found.of("e")) == [str(k) for k in range(p)]


@dataclass(frozen=True)
class Part:
    """Of nodes, what is asked of them here."""

    t: FloatArray
    flags: FloatArray

    def first_moving(self, seconds: float, standing: float) -> Part:
        return self


@pytest.mark.parametrize("size", [0.3, 0.02])
@pytest.mark.parametrize("factor", [0.99, 1.01])
def test_a_lasting_error_is_given_up_where_none_is_likelier_by_the_odds(
    size: float, factor: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Against the evidence: a normal prior of the logarithm, of which only the part up to the size
    is left, and one of how long it lasts, of which the drive leaves a share."""
    x, none = math.log(size) / LEVEL_SPREAD, math.log(ABSENT) / LEVEL_SPREAD
    below = 0.5 * math.erfc(-x / math.sqrt(2.0))
    base = dict.fromkeys(ALL_LEVELS, 1.0)
    # the climbs' scores hold the prior, which absence does not have
    curvature, row = 7.0, ALL_LEVELS.index(VELOCITY_TAU)
    left = 1.0 / math.sqrt(1.0 + curvature * LEVEL_SPREAD**2)
    lead = factor * LASTING_ODDS_NATS + math.log(below) + math.log(left)
    top = SimpleNamespace(factors=base | {VELOCITY_WANDER: size}, score=-0.5 * x**2)
    absent = SimpleNamespace(factors=base | {VELOCITY_WANDER: ABSENT}, score=lead - 0.5 * none**2)
    asked: list[Any] = []

    def climb(likelihood: Any, start: Any, levels: Any, bounds: Any) -> Any:
        asked.append((dict(start), tuple(levels), bounds(VELOCITY_WANDER), bounds("gyro")))
        return top if len(asked) == 1 else absent

    def likelihood(factors: dict[str, float], *_: Any) -> LevelLikelihood:
        slope, info = np.zeros((2, len(ALL_LEVELS)))
        slope[row] = -curvature * math.log(factors[VELOCITY_TAU])
        return LevelLikelihood(0.0, slope, info)

    monkeypatch.setattr(adapt, "climb", climb)
    monkeypatch.setattr(adapt, "level_likelihood", likelihood)
    monkeypatch.setattr(adapt, "scale_problem", lambda problem, factors: factors)
    monkeypatch.setattr(adapt, "scale_nodes", lambda nodes, factors: nodes)
    monkeypatch.setattr(adapt, "_below_white", lambda *_: True)
    monkeypatch.setattr(adapt, "room_for", lambda *_: None)
    problem: Any = SimpleNamespace(model=SimpleNamespace(size=2))
    path: Any = SimpleNamespace(nominal=np.zeros((3, 10)), params=np.zeros((3, 2)))
    nodes: Any = Part(np.arange(3.0), np.zeros(3, np.int64))
    none_of: Any = None
    found = adapt.refine_noise(
        problem, nodes, none_of, none_of, path, base | {"gyro": 0.5}, least={"gyro": 0.8}
    )
    assert found is (absent if factor > 1.0 else top).factors
    start, levels, wander, gyro = asked[0]
    assert VELOCITY_WANDER in levels
    # never below what the sensors have at rest
    assert start["gyro"] == 0.8
    assert (gyro[0], wander[0]) == (0.8, 1.0 / wander[1])
    start, levels, _, _ = asked[1]
    assert not {VELOCITY_WANDER, VELOCITY_TAU} & set(levels)
    assert (start[VELOCITY_WANDER], start[VELOCITY_TAU]) == (ABSENT, 1.0)


class ReachedError(Exception):
    """A test has what it wants."""


@pytest.mark.parametrize("delay_s", [0.0, 0.25, -0.4])
def test_halts_are_looked_for_in_the_fixes_time_and_told_in_the_readings(
    delay_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Many(SimpleNamespace):
        def __len__(self) -> int:
            return len(self.t_ns)

    imu = Many(t_ns=np.arange(500) * 10**7, gyro=np.zeros((500, 3)), accel=np.zeros((500, 3)))
    fixes = SimpleNamespace(t=np.arange(6.0), flags=np.full(6, HAS_POS_H), gps_s=np.arange(6.0))
    clock: Any = SimpleNamespace(t_ns=lambda gps_s: gps_s * 1e9)
    seen: dict[str, Any] = {}

    def halts(t: FloatArray, *_: Any) -> list[tuple[float, float]]:
        seen["t"] = t
        return [(1.0, 2.5), (3.0, 4.0)]

    def stop(spans: Any, model: Any) -> Any:
        seen["spans"] = spans
        raise ReachedError

    monkeypatch.setattr(
        preparation, "bridge_unusable", lambda imu: SimpleNamespace(imu=imu, stretch_s=np.zeros(1))
    )
    monkeypatch.setattr(preparation, "model_fixes", lambda *_: fixes)
    monkeypatch.setattr(preparation, "screen_fixes", lambda *_: SimpleNamespace(fixes=fixes))
    monkeypatch.setattr(preparation, "shown_speed", lambda model: (None, None, None))
    monkeypatch.setattr(preparation, "find_standstill", halts)
    monkeypatch.setattr(preparation, "unmoved", stop)
    options: Any = SimpleNamespace(wander_tau_s=1.0, effects=(), gap_force_sd=1.0, gap_rate_sd=0.1)
    delay: Any = SimpleNamespace(mean=delay_s, sd=0.1)
    with pytest.raises(ReachedError):
        engine.fuse_imu_gnss(imu, fixes, clock, options, delay)  # type: ignore[arg-type]
    assert seen["t"] == pytest.approx(np.arange(500) * 0.01 - delay_s)
    wanted = np.array([(1.0, 2.5), (3.0, 4.0)]) + delay_s
    np.testing.assert_allclose(seen["spans"], wanted)


@pytest.mark.parametrize("end", [0.0, 4.99])
@pytest.mark.parametrize("inside", [True, False])
def test_fixes_count_up_to_a_second_beside_the_readings(
    end: float, inside: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Many(SimpleNamespace):
        def __len__(self) -> int:
            return len(self.t_ns)

    def reached(model: Any) -> Any:
        raise ReachedError

    beside = FIX_EDGE_S + (-0.01 if inside else 0.01)
    at = end + (beside if end else -beside)
    imu = Many(t_ns=np.arange(500) * 10**7, gyro=np.zeros((500, 3)), accel=np.zeros((500, 3)))
    t = np.append(np.full(LEAST_FIXES - 1, 2.0), at)
    fixes = SimpleNamespace(t=t, flags=np.full(len(t), HAS_POS_H), gps_s=t)
    clock: Any = SimpleNamespace(t_ns=lambda gps_s: gps_s * 1e9)
    monkeypatch.setattr(
        preparation, "bridge_unusable", lambda imu: SimpleNamespace(imu=imu, stretch_s=np.zeros(1))
    )
    monkeypatch.setattr(preparation, "model_fixes", lambda *_: fixes)
    monkeypatch.setattr(preparation, "screen_fixes", lambda *_: SimpleNamespace(fixes=fixes))
    monkeypatch.setattr(preparation, "shown_speed", reached)
    options: Any = SimpleNamespace(wander_tau_s=1.0, effects=(), gap_force_sd=1.0, gap_rate_sd=0.1)
    delay: Any = SimpleNamespace(mean=0.0, sd=0.1)
    with pytest.raises(ReachedError if inside else InputError):
        engine.fuse_imu_gnss(imu, fixes, clock, options, delay)  # type: ignore[arg-type]


def path_of(place: ComplexArray, velocity: ComplexArray) -> Any:
    class Many(SimpleNamespace):
        def __len__(self) -> int:
            return len(self.t)

    n = len(place)
    return Many(t=np.arange(float(n)), place=place, velocity=velocity, sd=np.zeros(n))


def test_a_jump_after_a_stretch_is_to_the_row_after_it_or_to_the_last(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(3)
    place, right = (rng.normal(size=9) + 1j * rng.normal(size=9) for _ in range(2))
    monkeypatch.setattr(
        held_values, "plausible_sd", lambda path, over: 0.1 * (over.last - over.first)
    )
    path = path_of(place, place)
    for first, last in ((2, 5), (0, 0), (4, 7), (4, 8), (8, 8)):
        jump, sd = _jump_after(path, right, first, last)
        after = min(last + 1, 8)
        wanted = abs((place[after] - right[after]) - (place[first] - right[first]))
        assert jump == pytest.approx(wanted)
        assert sd == pytest.approx(np.hypot(0.1 * (after - first), limits.STEP_SD_M))


def test_long_repeats_are_those_of_a_walk_along_the_rows() -> None:
    rng = np.random.default_rng(4)
    place: ComplexArray = np.cumsum(rng.random(80) < 0.25) * np.complex128(1.0 + 0.5j)
    velocity: ComplexArray = np.cumsum(rng.random(80) < 0.5) * np.complex128(2.0 - 1.0j)
    wanted = np.zeros(80, bool)
    for values in (place, velocity):
        for k in range(80):
            begin, end = k, k
            while begin and values[begin - 1] == values[k]:
                begin -= 1
            while end < 79 and values[end + 1] == values[k]:
                end += 1
            wanted[k] |= k > begin and end - begin >= limits.LEAST_REPEATS
    assert 0 < wanted.sum() < 80
    assert in_long_repeats(path_of(place, velocity)).tolist() == wanted.tolist()


@pytest.mark.parametrize("beyond", [False, True])
def test_a_stuck_velocity_is_told_by_positions_that_part_over_many_steps(
    beyond: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Twenty rows of one velocity while the positions go half a metre a second aside, and jump."""
    n = 40
    velocity: ComplexArray = 0.1 * np.arange(n).astype(np.complex128) + 10.0
    velocity[10:31] = velocity[10]
    right = np.concatenate([[0.0], np.cumsum(velocity[:-1])])
    aside = np.zeros(n, np.complex128)
    aside[11:] += 0.5j * np.minimum(np.arange(n - 11) + 1.0, 20.0)
    aside[20:] += 7.0
    path = path_of(right + aside, velocity)
    jumps = 1 + int(20.0 / limits.JUMP_EVERY_S)
    apart = 0.5 * (20.0 - jumps)
    sd = apart / math.sqrt(2.0 * limits.CERTAIN_LEAD_NATS) * (0.99 if beyond else 1.01)
    monkeypatch.setattr(
        held_values, "plausible_sd", lambda path, over: np.full(len(over), sd / 2.0)
    )
    found = stuck_velocities(path, right, np.zeros(n, bool), 2.0)
    assert bool(found) == beyond
    if beyond:
        assert (found[0].first, found[0].last) == (10, 30)
        assert found[0].metres == pytest.approx(apart)


@pytest.mark.parametrize("side", range(1, 7))
def test_a_step_is_found_alike_from_either_end(side: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bins of which some, at one end, are a second higher: turned round in time the step is the
    opposite one at the place turned round, and is reported from as many bins on either side."""
    monkeypatch.setattr(steps, "bin_quantiles", lambda x, y, q: (x, y))
    n = 24
    x = np.arange(float(n))
    y = 0.001 * np.random.default_rng(side).random(n)
    y[n - side :] += 1.0
    here, there = find_step(x, y), find_step(-x[::-1], y[::-1])
    assert (here is None) == (there is None)
    if side >= limits.SIDE_BINS:
        assert here is not None
        assert there is not None
        assert here.size == pytest.approx(1.0, abs=0.003)
        assert here.x == pytest.approx(n - side - 0.5)
        assert there.x == pytest.approx(-here.x)
        assert there.size == pytest.approx(-here.size)
    else:
        # too few bins to show a level
        assert here is None
