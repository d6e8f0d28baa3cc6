"""The choice of objects for sightings against enumeration of all choices, and invariances of it."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from automap.geolocation import limits
from automap.geolocation.bearing_cover import (
    _best_set,
    _compact,
    candidates,
    cover,
    reassign,
)
from automap.geolocation.bearing_rays import BearingRules, Rays, costs, fit_point
from automap.geolocation.bearings import _without_single
from automap.mapping import limits as mapping
from automap.mapping.posts import support_numbers
from automap.records import FloatArray, IntArray

RULES = BearingRules(position_sd_m=0.3)


def rays_of(
    rng: np.random.Generator, points: FloatArray, centres: FloatArray, depth: float = 0.5
) -> tuple[Rays, IntArray]:
    """Every camera sees every point, a share of them with a depth; and whom each ray shows."""
    camera, owner = (
        a.ravel() for a in np.meshgrid(range(len(centres)), range(len(points)), indexing="ij")
    )
    offset = points[owner] - centres[camera]
    sd = np.full(len(owner), 0.02)
    bearing = np.arctan2(offset[:, 1], offset[:, 0]) + 0.3 * sd * rng.normal(size=len(owner))
    log_depth = np.log(np.linalg.norm(offset, axis=1)) + 0.05 * rng.normal(size=len(owner))
    log_depth[rng.random(len(owner)) >= depth] = np.nan
    return Rays(centres[camera], bearing, sd, log_depth, camera.astype(np.int64)), owner


def scene(seed: int, depth: float = 0.5) -> tuple[Rays, IntArray, FloatArray]:
    rng = np.random.default_rng(seed)
    points = np.array([[8.0, 6.0], [16.0, -7.0], [25.0, 9.0]])
    centres = np.column_stack([np.arange(0.0, 20.0, 6.0), 0.2 * rng.normal(size=4)])
    rays, owner = rays_of(rng, points, centres, depth)
    return rays, owner, points


def test_candidates_are_the_crossings_of_all_pairs_and_the_ends_of_rays_with_depth() -> None:
    rays, _, _ = scene(1)
    found = candidates(rays, RULES)
    direction = np.column_stack([np.cos(rays.bearing), np.sin(rays.bearing)])
    wanted = []
    for i, j in itertools.combinations(range(len(rays.centre)), 2):
        if rays.camera[i] == rays.camera[j]:
            continue
        angle = np.arccos(np.clip(abs(direction[i] @ direction[j]), 0.0, 1.0))
        if angle <= limits.LEAST_CROSSING:
            continue
        A = np.column_stack([direction[i], -direction[j]])
        along = np.linalg.solve(A, rays.centre[j] - rays.centre[i])
        if along.min() > limits.NEAREST_OBJECT_M and along.max() < RULES.max_range_m:
            wanted.append(rays.centre[i] + along[0] * direction[i])
    for k in np.flatnonzero(np.isfinite(rays.log_depth)):
        wanted.append(rays.centre[k] + np.exp(rays.log_depth[k]) * direction[k])
    # what nearly coincides is one: every place has a candidate of its cell, every candidate a place
    cells = {tuple(c) for c in np.round(np.array(wanted) / limits.SAME_CANDIDATE_M)}
    assert {tuple(c) for c in np.round(found / limits.SAME_CANDIDATE_M)} == cells
    assert len(found) == len(cells)
    apart = np.linalg.norm(found[:, None] - np.array(wanted)[None], axis=2).min(axis=1)
    assert apart.max() < 1e-9


@pytest.mark.parametrize("distance", [0.9, 1.1])
def test_rays_cross_ahead_of_the_nearest_and_within_the_range_of_both(distance: float) -> None:
    """An oblique crossing, at the edge of the one's and of the other's range."""
    reach = RULES.max_range_m
    for near, far in itertools.permutations((distance * limits.NEAREST_OBJECT_M, 20.0)):
        point = np.array([3.0, 1.0])
        turn = np.array([0.3, 1.2])
        away = np.array([near, far])[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
        rays = Rays(point - away, turn, np.full(2, 0.01), np.full(2, np.nan), np.arange(2))
        assert len(candidates(rays, RULES)) == (distance > 1.0)
    for one, other in itertools.permutations((reach * (2.0 - distance), 20.0)):
        away = np.array([one, other])[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
        rays = Rays(point - away, turn, np.full(2, 0.01), np.full(2, np.nan), np.arange(2))
        assert len(candidates(rays, RULES)) == (distance > 1.0)


def test_an_end_beyond_the_range_is_no_candidate() -> None:
    for factor, wanted in ((0.99, 1), (1.01, 0)):
        depth = np.log(np.array([factor * RULES.max_range_m]))
        rays = Rays(
            np.array([[2.0, 3.0]]), np.array([0.7]), np.array([0.02]), depth, np.zeros(1, int)
        )
        found = candidates(rays, RULES)
        assert len(found) == wanted
        if wanted:
            away = found[0] - [2.0, 3.0]
            assert np.hypot(*away) == pytest.approx(np.exp(depth[0]))
            assert np.arctan2(away[1], away[0]) == pytest.approx(0.7)


def test_the_sightings_of_a_point_are_those_of_all_subsets_that_gain_most() -> None:
    rays, _, points = scene(2)
    rng = np.random.default_rng(2)
    rows = rng.permutation(len(rays.centre))
    for point in (points[0] + 0.4, points[1] - 0.7, np.array([12.0, 1.0])):
        cost = costs(rays, rows, point[None], RULES)[:, 0]
        best = -RULES.object_cost
        per_camera = [[None, *np.flatnonzero(rays.camera[rows] == c).tolist()] for c in range(4)]
        for choice in itertools.product(*per_camera):
            some = [k for k in choice if k is not None]
            best = max(best, float(np.sum(RULES.alone_cost - cost[some])) - RULES.object_cost)
        chosen, gain = _best_set(rays, rows, point, RULES)
        assert gain == pytest.approx(best)
        assert len(set(rays.camera[chosen])) == len(chosen)
        own = costs(rays, chosen, point[None], RULES)[:, 0] if len(chosen) else np.zeros(0)
        assert gain == pytest.approx(float(np.sum(RULES.alone_cost - own)) - RULES.object_cost)


def greedy(
    rays: Rays, places: FloatArray, rules: BearingRules
) -> tuple[list[FloatArray], IntArray]:
    """The same choice with every gain reckoned anew each time."""
    owner = np.full(len(rays.centre), -1, np.int64)
    points: list[FloatArray] = []
    while True:
        best: tuple[float, FloatArray, IntArray] | None = None
        free = np.flatnonzero(owner < 0)
        for place in places:
            rows, _ = _best_set(rays, free, place, rules)
            if not len(rows):
                continue
            point = fit_point(rays, rows, place, rules)
            rows, gain = _best_set(rays, free, point, rules)
            if len(rows) and (best is None or gain > best[0] + 1e-9):
                best = gain, point, rows
        if best is None or best[0] <= 0.0:
            return points, owner
        _, point, rows = best
        owner[rows] = len(points)
        points.append(fit_point(rays, rows, point, rules))


@pytest.mark.parametrize("seed", [3, 4])
def test_the_lazy_greedy_choice_is_the_greedy_one(seed: int) -> None:
    rays, truth, points = scene(seed, depth=0.0)
    places = candidates(rays, RULES)
    found, owner = cover(rays, places, RULES)
    wanted, whose = greedy(rays, places, RULES)
    np.testing.assert_allclose(found, np.array(wanted), atol=2e-3)
    assert owner.tolist() == whose.tolist()
    # every point of the scene is found, by all who see it
    for k, point in enumerate(points):
        near = int(np.linalg.norm(found - point, axis=1).argmin())
        assert np.linalg.norm(found[near] - point) < 0.5
        assert (owner[truth == k] == near).all()


def test_a_turned_and_moved_scene_has_the_same_objects_turned_and_moved() -> None:
    rays, _, _ = scene(5)
    angle, shift = 1.1, np.array([120.0, -70.0])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = Rays(
        rays.centre @ turn.T + shift, (rays.bearing + angle) % (2.0 * np.pi), rays.sd,
        rays.log_depth, rays.camera,
    )  # fmt: skip
    places = candidates(rays, RULES)
    one, owner = cover(rays, places, RULES)
    other, whose = cover(moved, places @ turn.T + shift, RULES)
    np.testing.assert_allclose(other, one @ turn.T + shift, atol=1e-3)
    assert owner.tolist() == whose.tolist()


def test_one_sighting_that_gains_nothing_makes_an_object_only_by_its_depth() -> None:
    rules = BearingRules(position_sd_m=0.3, object_cost=7.5)
    for depth, wanted in ((np.log(9.0), 1), (np.nan, 0)):
        rays = Rays(
            np.zeros((1, 2)), np.array([0.4]), np.array([0.02]), np.array([depth]), np.zeros(1, int)
        )
        place = 9.0 * np.array([[np.cos(0.4), np.sin(0.4)]])
        found, owner = cover(rays, place, rules)
        assert len(found) == wanted
        assert owner.tolist() == [wanted - 1]
        assert cover(rays, np.zeros((0, 2)), rules)[1].tolist() == [-1]


def test_sightings_that_were_given_wrongly_go_where_they_cost_least() -> None:
    rays, truth, points = scene(6)
    wrong = truth.copy()
    first = np.flatnonzero(rays.camera == 1)
    wrong[first] = np.roll(truth[first], 1)
    wrong[np.flatnonzero(rays.camera == 2)[0]] = -1
    found, owner = reassign(rays, points + 0.2, wrong, RULES)
    assert len(found) == 3
    same = [int(np.linalg.norm(found - p, axis=1).argmin()) for p in points]
    assert owner.tolist() == [same[k] for k in truth]
    for k, point in enumerate(points):
        wanted = fit_point(rays, np.flatnonzero(truth == k), point, RULES)
        assert found[same[k]] == pytest.approx(wanted, abs=2e-3)


def test_objects_without_sightings_and_on_another_are_dropped() -> None:
    rays, truth, points = scene(8, depth=0.0)
    owner = np.where(truth == 2, -1, truth)
    lone = np.flatnonzero(truth == 2)[0]
    owner[lone] = 2
    found, whose = _compact(rays, points, owner, RULES)
    # a single direction makes no object
    assert len(found) == 2
    assert (whose[truth == 2] == -1).all()
    assert set(whose[truth < 2]) == {0, 1}
    # two of one place are one, that with more sightings
    split = truth.copy()
    split[np.flatnonzero(truth == 0)[:1]] = 3
    rays_with = Rays(
        rays.centre, rays.bearing, rays.sd,
        np.log(np.linalg.norm(points[truth] - rays.centre, axis=1)), rays.camera,
    )  # fmt: skip
    found, whose = _compact(rays_with, np.vstack([points, points[0]]), split, RULES)
    assert len(found) == 3
    assert whose[split == 3].tolist() == [-1]


def test_objects_of_one_sighting_are_left_out_and_the_others_numbered_anew() -> None:
    points = np.arange(8.0).reshape(4, 2)
    found, owner = _without_single(points, np.array([3, 0, 1, 3, -1, 1, 1]))
    assert found.tolist() == points[[1, 3]].tolist()
    assert owner.tolist() == [1, -1, 0, 1, -1, 0, 0]


@pytest.mark.parametrize("seed", range(4))
def test_supports_are_the_connected_parts_of_all_pairs(seed: int) -> None:
    """Against a closure of the relation, pair by pair."""
    rng = np.random.default_rng(seed)
    n = 24
    position = np.column_stack([rng.uniform(0.0, 12.0, (n, 2)), rng.normal(0.0, 9.0, n)])
    position[1::3, :2] = position[::3, :2] + rng.normal(0.0, 0.5, (n // 3, 2))
    own = rng.uniform(0.0, 0.4, n)
    overhead = rng.random(n) < 0.15
    near = np.zeros((n, n), bool)
    for i, j in itertools.product(range(n), repeat=2):
        apart = float(np.hypot(*(position[i] - position[j])[:2]))
        if overhead[i] and overhead[j]:
            near[i, j] = apart <= mapping.GANTRY_REACH_M
        else:
            variance = own[i] + own[j]
            near[i, j] = apart < min(mapping.POST_REACH_M + variance**0.5, mapping.POST_LIMIT_M)
    np.fill_diagonal(near, True)
    closure = np.linalg.matrix_power(near.astype(float), n) > 0.0
    first = [int(np.flatnonzero(row)[0]) for row in closure]
    wanted = [sorted(set(first)).index(f) for f in first]
    assert support_numbers(position, own, overhead.tolist()) == wanted


@pytest.mark.parametrize(("apart", "posts"), [(0.62, [0, 0]), (0.67, [0, 1])])
def test_two_faces_are_of_one_post_up_to_their_mean_variance_in_plan(
    apart: float, posts: list[int]
) -> None:
    # half a metre and the root of 0.02 m^2, an axis of both together: 0.64 m
    own = np.array([0.012, 0.008])
    position = np.array([[3.0, -2.0, 1.0], [3.0, -2.0 + apart, 2.5]])
    assert support_numbers(position, own, [False, True]) == posts
