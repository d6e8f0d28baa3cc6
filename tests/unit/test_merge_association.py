"""Which sightings of several drives are one sign."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from merge_scene import Errors, Scene, Town, drive_through, street_scene

from automap.mapping.association import associate
from automap.mapping.by_cells import joined_signs
from automap.mapping.candidates import columns_of
from automap.mapping.classes import class_evidence
from automap.mapping.grid import filled_table, neighbours
from automap.mapping.limits import DIFFERENT, LEAST_SD_M, SAME, UNKNOWN_SD_M
from automap.mapping.sightings import (
    canonical_order,
    split_covariance,
    stack_sightings,
)
from automap.records import IntArray


def groups(scene: Scene) -> tuple[IntArray, IntArray]:
    """Map sign and true sign of every sighting."""
    sightings = stack_sightings(scene.drives)
    found = joined_signs(sightings)
    truth = np.concatenate(
        [
            own[sightings.row[sightings.first[k] : sightings.first[k + 1]]]
            for k, own in enumerate(scene.truth)
        ]
    )
    return found, truth


def pair_scores(sign: IntArray, truth: IntArray) -> tuple[float, float]:
    """Part of the true pairs found, and of the found pairs that are true."""
    real = truth >= 0
    sign, truth = sign[real], truth[real]

    def pairs(values: list[object]) -> int:
        return sum(n * (n - 1) // 2 for n in Counter(values).values())

    both = pairs(list(zip(sign.tolist(), truth.tolist(), strict=True)))
    return both / pairs(truth.tolist()), both / pairs(sign.tolist())


@pytest.mark.parametrize("drives", [2, 6])
def test_signs_of_several_drives_are_found_to_be_one(drives: int) -> None:
    scores = [pair_scores(*groups(street_scene(seed, drives))) for seed in range(3)]
    recall, precision = np.mean(scores, axis=0)
    # two drives that each miss one of two neighbours cannot be told from two of one sign
    assert recall > 0.97
    assert precision > 0.96


def test_kernels_get_columns_of_one_layout_wherever_they_come_from() -> None:
    """For one in another order, or that is not to be written to, all would be compiled again."""
    sightings = stack_sightings(street_scene(3, 2).drives)
    read = sightings.confidence.copy()
    read.flags.writeable = False
    strided = np.repeat(sightings.own_u, 2)[::2]
    other = replace(
        sightings,
        confidence=read,
        own_u=strided,
        shared_sd=np.asfortranarray(sightings.shared_sd),
    )
    for plain, column in zip(columns_of(sightings), columns_of(other), strict=True):
        assert column.flags.c_contiguous
        assert column.flags.writeable
        np.testing.assert_array_equal(column, plain)


def test_of_a_sign_that_was_founded_twice_one_is_left() -> None:
    """Paths that err by five metres found signs twice; each goes over to the one that more saw."""
    right = total = 0
    for seed in (70716, 70717):
        far = Errors(shared=(5.0, 5.0, 6.0))
        sign, truth = groups(street_scene(seed, 20, 1000.0, 20.0, far))
        for k in np.unique(truth[truth >= 0]):
            found = np.unique(sign[truth == k])
            right += len(found) == 1 and bool((truth[sign == found[0]] == k).all())
            total += 1
    assert right > 0.88 * total, f"{right} of {total}"


def test_signs_of_drives_that_are_metres_off_are_found_to_be_one() -> None:
    """Phones between houses: paths wander by more than signs lie apart, heights the most."""
    errors = Errors(shared=(3.0, 3.0, 5.0))
    scores = [pair_scores(*groups(street_scene(s, 8, 1000.0, errors=errors))) for s in (71, 72, 73)]
    recall, precision = np.mean(scores, axis=0)
    assert recall > 0.95
    assert precision > 0.96


def test_an_offset_larger_than_the_distance_of_signs_is_recognised() -> None:
    """Signs every 7 m, drives off by up to 6 m: only together do they fit."""
    rng = np.random.default_rng(3)
    along = np.cumsum(rng.uniform(6.0, 9.0, 40))
    town = Town(
        np.column_stack([np.full(40, -5.0), along, np.full(40, 2.5)]),
        np.full(40, np.pi),
        np.full(40, "regulatory--stop--g1", object),
    )
    path = np.array([[-1.5, -40.0], [-1.5, along[-1] + 40.0]])
    errors = Errors(
        shared=(2.5, 2.5, 1.0), own_along=0.3, own_across=0.15, tau_s=None, clutter=0, missed=0.05
    )
    scene = Scene(town)
    for number in range(4):
        drive, truth = drive_through(
            rng, town, path, 12.0, f"d{number}", 1.4e9 + 1e5 * number, errors
        )
        scene.drives.append(drive)
        scene.truth.append(truth)
    recall, precision = pair_scores(*groups(scene))
    assert recall > 0.95
    assert precision > 0.95


@pytest.mark.parametrize("same_class", [True, False])
def test_neighbours_a_metre_and_a_half_apart_stay_two(same_class: bool) -> None:
    rng = np.random.default_rng(5)
    along = np.repeat(np.arange(12) * 60.0, 2) + np.tile([0.0, 1.5], 12)
    names = ["regulatory--stop--g1", "regulatory--stop--g1" if same_class else "warning--x--g1"]
    town = Town(
        np.column_stack([np.full(24, -5.0), along, np.full(24, 2.5)]),
        np.full(24, np.pi),
        np.array(names * 12, object),
    )
    path = np.array([[-1.5, -40.0], [-1.5, 760.0]])
    scene = Scene(town)
    for number in range(6):
        drive, truth = drive_through(rng, town, path, 12.0, f"d{number}", 1.4e9 + 1e5 * number)
        scene.drives.append(drive)
        scene.truth.append(truth)
    sign, truth = groups(scene)
    apart = 0
    for k in range(12):
        first = Counter(sign[truth == 2 * k].tolist()).most_common(1)[0][0]
        second = Counter(sign[truth == 2 * k + 1].tolist()).most_common(1)[0][0]
        apart += first != second
    assert apart == 12
    assert pair_scores(sign, truth)[1] > 0.9


def test_one_drive_never_gives_two_sightings_to_one_sign_in_passing() -> None:
    scene = street_scene(2, 5)
    sightings = stack_sightings(scene.drives)
    sign = associate(sightings)
    pairs = sightings.drive * (int(sign.max()) + 2) + sign
    assert len(np.unique(pairs)) == len(pairs)


def test_faces_that_look_away_from_one_another_are_two_signs() -> None:
    rng = np.random.default_rng(1)
    town = Town(
        np.array([[-5.0, 100.0, 2.5], [-5.0, 100.1, 2.5]]),
        np.array([np.pi, 0.0]),
        np.full(2, "regulatory--stop--g1", object),
    )
    there = np.array([[-1.5, 0.0], [-1.5, 200.0]])
    plain = Errors(missed=0.0, clutter=0.0, wrong_class=0.0)
    scene = Scene(town)
    for number, path in enumerate([there, there[::-1]]):
        drive, truth = drive_through(
            rng, town, path, 12.0, f"d{number}", 1.4e9 + 1e5 * number, plain
        )
        scene.drives.append(drive)
        scene.truth.append(truth)
    sign, truth = groups(scene)
    assert sorted(truth.tolist()) == [0, 1]
    assert sign[0] != sign[1]


@pytest.mark.parametrize(("same_class", "signs"), [(True, 3), (False, 4)])
def test_a_sign_seen_from_far_away_only_is_the_one_that_the_map_has(
    same_class: bool, signs: int
) -> None:
    """Its place is 25 m off along the view, with a sigma of 12 m."""
    rng = np.random.default_rng(4)
    names = ("regulatory--stop--g1", "warning--children--g1", "information--hospital--g1")
    along = np.array([100.0, 160.0, 220.0])
    place = np.column_stack([np.full(3, -5.0), along, np.full(3, 2.5)])
    town = Town(place, np.full(3, np.pi), np.array(names, object))
    path = np.array([[-1.5, 0.0], [-1.5, 260.0]])
    plain = Errors(missed=0.0, clutter=0.0, wrong_class=0.0)
    scene = Scene(town)
    for number in range(4):
        drive, truth = drive_through(
            rng, town, path, 12.0, f"d{number}", 1.4e9 + 1e5 * number, plain
        )
        if number == 3:
            (far,) = np.flatnonzero(truth == 2)
            lat, cov, name = drive.lat_rad.copy(), drive.cov_enu.copy(), drive.class_name.copy()
            lat[far] += 25.0 / 6.36e6
            cov[far, 1, 1] += 12.0**2
            name[far] = names[2] if same_class else "warning--road-bump--g1"
            drive = replace(drive, lat_rad=lat, cov_enu=cov, class_name=name)
        scene.drives.append(drive)
        scene.truth.append(truth)
    sign, _ = groups(scene)
    assert len(np.unique(sign)) == signs


def test_the_order_of_the_drives_is_by_time_and_name() -> None:
    drives = street_scene(1, 4, length_m=200.0).drives
    order = canonical_order([drives[k] for k in (2, 0, 3, 1)])
    assert order == [1, 3, 0, 2]


def test_no_sightings_make_an_empty_association() -> None:
    sightings = stack_sightings([])
    assert len(associate(sightings)) == 0


def test_classes_of_one_group_are_easier_taken_for_one_another() -> None:
    names = [
        "regulatory--maximum-speed-limit-50--g1",
        "regulatory--maximum-speed-limit-60--g1",
        "regulatory--unknown-red-circle",
        "information--parking--g1",
    ]
    table = class_evidence(names)
    assert (np.diag(table) == SAME).all()
    assert table[0, 2] > table[0, 1] > table[0, 3]
    assert table[0, 3] == DIFFERENT
    assert (table == table.T).all()


def test_the_shared_part_never_exceeds_the_whole_covariance() -> None:
    rng = np.random.default_rng(0)
    a = rng.standard_normal((50, 3, 3))
    total = a @ a.transpose(0, 2, 1) + 0.01 * np.eye(3)
    own, own_u, shared = split_covariance(total, rng.uniform(0.0, 4.0, (50, 3)))
    assert (own[:, 0] > 0).all()
    assert (own[:, 0] * own[:, 2] > own[:, 1] ** 2).all()
    assert (own_u > 0).all()
    rebuilt = own[:, 0] + shared[:, 0] ** 2
    assert rebuilt == pytest.approx(total[:, 0, 0] + 0.02**2)


def test_east_and_north_are_less_than_wholly_correlated_or_unknown() -> None:
    rng = np.random.default_rng(4)
    ee, nn = rng.uniform(0.1, 30.0, (2, 40))
    share = np.tile([-1.01, -0.99, 0.99, 1.01], 10)
    cov = np.zeros((40, 3, 3))
    cov[:, 0, 0], cov[:, 1, 1], cov[:, 2, 2] = ee, nn, 1.0
    cov[:, 0, 1] = cov[:, 1, 0] = share * np.sqrt(ee * nn)
    own, _, _ = split_covariance(cov, np.zeros((40, 3)))
    known = np.abs(share) < 1.0
    assert own[known, 0] == pytest.approx(ee[known] + LEAST_SD_M**2)
    assert own[known, 1] == pytest.approx(cov[known, 0, 1])
    assert own[~known, 0] == pytest.approx(UNKNOWN_SD_M**2 + LEAST_SD_M**2)
    assert not own[~known, 1].any()


@pytest.mark.parametrize(("lat", "lon"), [(-35.0, 149.0), (60.0, 179.9999), (0.0, -180.0)])
def test_the_grid_finds_all_neighbours_also_at_the_date_line(lat: float, lon: float) -> None:
    rng = np.random.default_rng(7)
    n, cell = 300, 16.0
    north = rng.uniform(-60, 60, n)
    east = rng.uniform(-60, 60, n)
    lats = np.radians(lat) + north / 6.371e6
    lons = np.radians(lon) + east / (6.371e6 * np.cos(np.radians(lat)))
    lons = (lons + np.pi) % (2 * np.pi) - np.pi
    table = filled_table(lats, lons, cell)
    found = np.empty(n, np.int64)
    for k in range(n):
        count = neighbours(table, lats[k], lons[k], 1, found)
        near = np.flatnonzero(np.hypot(north - north[k], east - east[k]) < 0.99 * cell)
        assert set(near.tolist()) <= set(found[:count].tolist())
        assert len(set(found[:count].tolist())) == count
