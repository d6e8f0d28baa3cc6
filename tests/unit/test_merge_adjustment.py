"""Where merged signs stand and how surely."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from merge_scene import Errors, Scene, levels_told, street_scene, to_enu

from automap.mapping import limits
from automap.mapping.adjustment import (
    Adjusted,
    adjust,
)
from automap.mapping.drive_levels import error_levels
from automap.mapping.limits import COMMON_SD_M
from automap.mapping.sightings import Sightings, stack_sightings
from automap.mapping.tiles import cut_tiles

NOTHING = np.zeros(0, np.int64)
QUIET = Errors(clutter=0.0, wrong_class=0.0)


def known_association(scene: Scene) -> tuple[Sightings, np.ndarray, np.ndarray]:
    """The true association of a scene without clutter, and the true sign of each map sign."""
    sightings = stack_sightings(scene.drives)
    truth = np.concatenate(
        [
            own[sightings.row[sightings.first[k] : sightings.first[k + 1]]]
            for k, own in enumerate(scene.truth)
        ]
    )
    signs, number = np.unique(truth, return_inverse=True)
    return sightings, number.astype(np.int64), signs


def brute_force(sightings: Sightings, sign: np.ndarray, tau_s: float) -> tuple[np.ndarray, ...]:
    """Generalised least squares over everything at once, east and north."""
    m, n = int(sign.max()) + 1, len(sightings)
    covariance = np.zeros((2 * n, 2 * n))
    for i in range(n):
        for j in range(n):
            if sightings.drive[i] == sightings.drive[j]:
                keep = np.exp(-abs(sightings.time_s[i] - sightings.time_s[j]) / tau_s)
                keep = limits.LASTING_ERROR + (1.0 - limits.LASTING_ERROR) * keep
                for a in range(2):
                    covariance[2 * i + a, 2 * j + a] = (
                        keep * sightings.shared_sd[i, a] * sightings.shared_sd[j, a]
                    )
        own = sightings.own[i]
        covariance[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] += [[own[0], own[1]], [own[1], own[2]]]
    design = np.zeros((2 * n, 2 * m))
    for i in range(n):
        for a in range(2):
            design[2 * i + a, 2 * sign[i] + a] = 1.0
    z = to_enu(sightings.lat, sightings.lon, sightings.height)[:, :2].ravel()
    weight = np.linalg.inv(covariance)
    normal = np.linalg.inv(design.T @ weight @ design)
    return (normal @ design.T @ weight @ z).reshape(m, 2), normal


def test_one_tile_equals_the_whole_problem_solved_at_once() -> None:
    scene = street_scene(1, 4, length_m=250.0, errors=QUIET)
    sightings, association, _ = known_association(scene)
    result = adjust(sightings, association)
    place, normal = brute_force(sightings, association, 60.0)
    enu = to_enu(result.lat, result.lon, result.height)
    # a sighting far off its sign counts less, which the plain formula does not have
    assert np.abs(enu[:, :2] - place).max() < 0.05
    for k in range(len(place)):
        expected = normal[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] + COMMON_SD_M**2 * np.eye(2)
        assert result.cov_enu[k, :2, :2] == pytest.approx(expected, rel=0.1, abs=0.005)


def errors_of(result: Adjusted, scene: Scene, signs: np.ndarray) -> np.ndarray:
    return to_enu(result.lat, result.lon, result.height) - scene.town.position[signs]


@pytest.mark.parametrize("tau_s", [60.0, None])
def test_covariances_hold_when_a_drives_signs_share_its_error(tau_s: float | None) -> None:
    """Also where the error does not wander at all, in place of the minute assumed."""
    inside, square_up = [], []
    errors = Errors(clutter=0.0, wrong_class=0.0, tau_s=tau_s)
    for seed in range(40):
        scene = street_scene(seed, 5, length_m=300.0, spacing_m=30.0, errors=errors)
        sightings, association, signs = known_association(scene)
        result = adjust(sightings, association)
        error = errors_of(result, scene, signs)
        plan = result.cov_enu[:, :2, :2]
        square = np.einsum(
            "ni,ni->n", error[:, :2], np.linalg.solve(plan, error[:, :2, None])[:, :, 0]
        )
        inside.append(float((square < 5.991).mean()))
        square_up += (error[:, 2] ** 2 / result.cov_enu[:, 2, 2]).tolist()
    # 40 scenes, whose signs share most of their error: one sigma of this is 0.02
    assert 0.90 < np.mean(inside) < 0.99
    assert 0.7 < np.mean(square_up) < 1.35


def test_five_passes_halve_the_error_and_more() -> None:
    one, five = [], []
    for seed in range(15):
        for drives, errors in ((1, one), (5, five)):
            scene = street_scene(seed, drives, 400.0, errors=QUIET, both_ways=False)
            sightings, association, signs = known_association(scene)
            found = adjust(sightings, association)
            errors += np.hypot(*errors_of(found, scene, signs)[:, :2].T).tolist()
    assert np.median(five) < 0.5
    assert np.median(five) < 0.65 * np.median(one)


def test_the_drives_offsets_are_told_with_their_uncertainty() -> None:
    square = []
    for seed in range(20):
        scene = street_scene(
            seed, 6, length_m=300.0, errors=Errors(tau_s=None, clutter=0.0, wrong_class=0.0)
        )
        sightings, association, _ = known_association(scene)
        result = adjust(sightings, association)
        for number, drive in enumerate(scene.drives):
            true = to_enu(drive.lat_rad, drive.lon_rad, drive.height_m)
            true = true - scene.town.position[scene.truth[number]]
            miss = result.drive_offset[number] - true.mean(axis=0)
            square.append(miss**2 / (result.drive_sd[number] ** 2 + 0.1**2))
    assert (np.mean(square, axis=0) < 1.6).all()


def test_a_stray_sighting_among_many_pulls_little() -> None:
    scene = street_scene(4, 8, length_m=300.0, errors=QUIET)
    sightings, association, _ = known_association(scene)
    before = adjust(sightings, association)
    target = int(np.argmax(np.bincount(association)))
    row = int(np.flatnonzero(association == target)[0])
    sightings.lat[row] += 5.0 / sightings.per_lat[row]
    after = adjust(sightings, association)
    moved = (after.lat[target] - before.lat[target]) * sightings.per_lat[row]
    assert abs(moved) < 0.4


def test_heights_that_are_not_known_stay_unknown() -> None:
    scene = street_scene(4, 3, length_m=200.0, errors=QUIET)
    sightings, association, _ = known_association(scene)
    sightings.height[association == 0] = np.nan
    result = adjust(sightings, association)
    assert np.isnan(result.height[0])
    assert np.isnan(result.cov_enu[0, 2, 2])
    assert np.isfinite(result.height[1:]).all()
    assert np.isfinite(result.lat).all()


@pytest.mark.parametrize("value", [np.nan, np.inf, -5.0, 1e200])
@pytest.mark.parametrize("place", [(0, 0), (0, 1), (1, 1), (2, 2)])
def test_what_is_no_covariance_counts_as_unknown(value: float, place: tuple[int, int]) -> None:
    """By hand: a sign of two drives without paths is the mean of both by inverse variance, that of
    the bad one being of metres; the other signs are as they were."""
    scene = street_scene(2, 2, length_m=200.0, errors=QUIET)
    drives = [replace(drive, path=None) for drive in scene.drives]
    sound = stack_sightings(drives)
    _, association, _ = known_association(scene)
    rows = [np.flatnonzero(association == k) for k in range(int(association.max()) + 1)]
    mine = next(k for k, of in enumerate(rows) if sound.drive[of].tolist() == [0, 1])
    bad, good = rows[mine]
    cov = drives[0].cov_enu.copy()
    cov[sound.row[bad], place[0], place[1]] = cov[sound.row[bad], place[1], place[0]] = value
    sightings = stack_sightings([replace(drives[0], cov_enu=cov), drives[1]])
    result, before = adjust(sightings, association), adjust(sound, association)
    axes = slice(2, 3) if place == (2, 2) else slice(0, 2)
    unknown = (limits.UNKNOWN_SD_M**2 + limits.LEAST_SD_M**2) * np.eye(3)[axes, axes]
    known = (drives[1].cov_enu[sound.row[good]] + limits.LEAST_SD_M**2 * np.eye(3))[axes, axes]
    a, b = np.linalg.inv(unknown), np.linalg.inv(known)
    z = to_enu(sightings.lat, sightings.lon, sightings.height)[[bad, good]][:, axes]
    found = to_enu(result.lat, result.lon, result.height)[mine, axes]
    assert found == pytest.approx(np.linalg.solve(a + b, a @ z[0] + b @ z[1]), abs=1e-4)
    total = np.linalg.inv(a + b) + COMMON_SD_M**2 * np.eye(len(found))
    assert result.cov_enu[mine, axes, axes] == pytest.approx(total, rel=1e-6)
    others = np.arange(int(association.max()) + 1) != mine
    assert result.lat[others] == pytest.approx(before.lat[others], abs=1e-12)
    assert result.cov_enu[others] == pytest.approx(before.cov_enu[others], rel=1e-9)


def test_error_levels_follow_what_the_drives_show() -> None:
    """Drives that state half of their true errors are not believed for long."""
    scene = street_scene(6, 12, length_m=1200.0, errors=QUIET)
    sightings, association, _ = known_association(scene)
    honest, _ = levels_told(sightings, association)
    assert 0.75 < honest[2] < 1.3
    sightings.own[:] *= 0.25
    found, _ = levels_told(sightings, association)
    assert found[2] > 1.5
    assert error_levels([], 0)[0].tolist() == [1.0, 1.0, 1.0]


def test_every_sign_is_the_core_of_one_tile() -> None:
    rng = np.random.default_rng(2)
    lat = np.radians(-35.0 + 0.02 * rng.random(700))
    lon = np.radians(149.0 + 0.02 * rng.random(700))
    tiles = list(cut_tiles(lat, lon, core=40, margin_m=80.0))
    assert sorted(np.concatenate([t.core for t in tiles]).tolist()) == list(range(700))
    for tile in tiles:
        assert tile.signs[: len(tile.core)].tolist() == tile.core.tolist()
        assert len(np.unique(tile.signs)) == len(tile.signs)


def test_an_error_that_lasts_all_along_a_drive_is_not_taken_for_a_small_one() -> None:
    """Two drives whose errors are as large as stated, but hardly change along the street: their
    signs agree far better than the drives are good."""
    sds = []
    errors = replace(QUIET, tau_s=3600.0, own_along=0.06, own_across=0.06)
    for seed in range(4):
        scene = street_scene(seed, 2, 1500.0, spacing_m=40.0, errors=errors, both_ways=False)
        sightings, association, _ = known_association(scene)
        result = adjust(sightings, association, levels_told(sightings, association)[0])
        sds.append(float(np.sqrt(np.median(result.cov_enu[:, 0, 0]))))
    assert 0.85 < np.mean(sds) / (errors.shared[0] / np.sqrt(2.0)) < 1.15
