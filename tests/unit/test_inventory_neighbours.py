"""Signs that stand in company, on a map whose errors neighbours have in common."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from automap.earth import from_local_ned
from automap.inventory.comparison import InventoryComparison, compare_inventory
from automap.inventory.findings import Inventory
from automap.inventory.neighbours import Looks, neighbour_density, neighbours_of
from automap.inventory.wander import Anchors, common_errors
from automap.records import FloatArray, Sign

ORIGIN = (-0.6, 2.6, 500.0)
LIMITS = [f"regulatory--maximum-speed-limit-{k}--g1" for k in (30, 50, 60, 80, 100)]
SHOULDER, N = 1.5, 40


def sign(k: int, place: FloatArray, name: str, sd: float = 1.2) -> Sign:
    lat, lon, _ = from_local_ned(np.array([[*place, 0.0]]), ORIGIN)
    return Sign(
        f"s{k}", name, float(lat[0]), float(lon[0]), 500.0, sd**2 * np.eye(3), 0.99, 9, 0, 0, 2.0,
        np.pi, 0.6, "", class_probability=0.99, existence=0.99,
    )  # fmt: skip


@cache
def street(wander_m: float) -> tuple[InventoryComparison, Inventory, list[Sign]]:
    """Every second of 40 signs, 40 m apart, has another one 1.5 m to its right; the map is off
    by up to ``wander_m``, slowly to and fro. Listed is one of the pair at 8, and the other seen."""
    rng = np.random.default_rng(5)
    place = np.array([(40.0 * (k // 2), SHOULDER * (k % 2)) for k in range(2 * N) if k % 4 != 3])
    names = [LIMITS[k] for k in rng.integers(0, len(LIMITS), len(place))]
    beside = int(np.flatnonzero((place[:, 0] == 320.0) & (place[:, 1] == SHOULDER))[0])
    names[beside - 1], names[beside] = LIMITS[0], LIMITS[1]
    phase = 2.0 * np.pi * place[:, 0] / 700.0
    off = wander_m * np.column_stack([np.sin(phase), np.cos(phase)])
    seen = place + off + 0.15 * rng.standard_normal(place.shape)
    signs = [sign(k, seen[k], names[k]) for k in range(len(place)) if k != beside]
    kept = [k for k in range(len(place)) if k != beside - 1]
    rough = place + 0.2 * rng.standard_normal(place.shape)
    lat, lon, _ = from_local_ned(np.column_stack([rough, np.zeros(len(place))])[kept], ORIGIN)
    none = np.full(len(kept), np.nan)
    inventory = Inventory(
        [f"L{k}" for k in kept], [names[k] for k in kept], lat, lon, np.full(len(kept), np.pi), none
    )
    return compare_inventory(signs, inventory, []), inventory, signs


def test_the_neighbour_of_an_unseen_sign_is_not_that_sign_under_another_name() -> None:
    """Where the map is off by as much as the two stand apart, the signs about them tell."""
    result, inventory, signs = street(1.2)
    seen, listed = [s.id for s in signs].index("s12"), list(inventory.ids).index("L13")
    assert {f.kind for f in result.findings if f.sign == seen} == {"new"}
    assert not any(f.sign >= 0 for f in result.findings if f.listed == listed)
    # and what the map is off in common is no error of the list
    assert 0.15 < result.sd_m < 0.4


def test_signs_in_place_are_the_nearer_the_more_others_tell() -> None:
    for wander in (0.0, 1.2):
        matched = [f for f in street(wander)[0].findings if f.kind == "matched"]
        assert len(matched) > 50
        assert np.sqrt(np.mean([f.distance_m**2 for f in matched]) / 2.0) < 0.4
        assert np.median([f.sd_m for f in matched]) < 0.5


def test_errors_in_common_are_predicted_without_the_pair_itself() -> None:
    rng = np.random.default_rng(3)
    n = 60
    place = np.column_stack([25.0 * np.arange(n), np.zeros(n)])
    signs = [sign(k, place[k], LIMITS[0]) for k in range(n)]
    smooth = 1.5 * np.column_stack([np.sin(place[:, 0] / 90.0), np.cos(place[:, 0] / 90.0)])
    residual = smooth + 0.2 * rng.standard_normal((n, 2))
    number = np.arange(n)
    mean, variance = common_errors(
        signs, Anchors(number, number, residual, np.full(n, 1.2)), number, number
    )
    error = mean - smooth
    assert 0.05 < np.sqrt(np.mean(error**2)) < 0.25
    assert 0.5 < np.mean(error[3:-3] ** 2) / np.mean(variance[3:-3]) < 2.0
    # one that is off by itself does not tell of itself
    spoilt = residual.copy()
    spoilt[30] += 4.0
    again, _ = common_errors(
        signs, Anchors(number, number, spoilt, np.full(n, 1.2)), number[30:31], number[30:31]
    )
    assert np.abs(again - smooth[30]).max() < 0.6
    # and where nothing is in common nothing is taken off
    white = rng.standard_normal((n, 2))
    none, left = common_errors(
        signs, Anchors(number, number, white, np.full(n, 1.0)), number, number
    )
    assert np.sqrt(np.mean(none**2)) < 0.5
    assert left.max() < 0.5


def test_neighbours_are_as_dense_as_the_list_has_them() -> None:
    """The mean over a disc is the number of neighbours in it."""
    rng = np.random.default_rng(1)
    n = 400
    first = np.column_stack([60.0 * np.arange(n), np.zeros(n)])
    angle = rng.uniform(0.0, 2.0 * np.pi, n)
    second = first + 3.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    place = np.vstack([first, second[: n // 4]])
    lat, lon, _ = from_local_ned(np.column_stack([place, np.zeros(len(place))]), ORIGIN)
    names = [LIMITS[k] for k in rng.integers(0, 5, len(place))]
    none = np.full(len(place), np.nan)
    inventory = Inventory([""] * len(place), names, lat, lon, none, none)
    neighbours = neighbours_of(inventory)
    # each of a hundred pairs counts for both
    assert np.isclose(neighbours.sum(), 200 / len(place))
    apart = np.linspace(0.02, 8.0, 400)
    density = neighbour_density(neighbours, apart, np.full(400, 0.5), Looks.blank(400))
    assert np.isclose((density * 2.0 * np.pi * apart * apart[0]).sum(), 200 / len(place), rtol=0.02)
    assert abs(apart[np.argmax(density)] - 3.0) < 0.4
    # one that looks the other way is found where such ones stand
    turned = replace(inventory, facing_rad=np.where(np.arange(len(place)) < n, 0.0, np.pi))
    for turn, many in ((np.pi, True), (0.0, False)):
        looks = replace(Looks.blank(1), turn_rad=np.array([turn]))
        there = neighbour_density(neighbours_of(turned), np.array([3.0]), np.array([0.5]), looks)
        assert (there[0] > 3.0 * density.max()) == many


def test_a_face_that_the_map_hardly_knows_keeps_no_sign_from_its_entry() -> None:
    # the crossing street's signs are seen at a slant: 50 deg of sigma are stated for them
    class_name = LIMITS[0]
    lat, lon, _ = from_local_ned(np.outer(np.arange(8) * 100.0, [1.0, 0.0, 0.0]), ORIGIN)
    turn = np.radians(115.0)
    for sd, matched in ((np.radians(50.0), 8), (np.radians(8.0), 7)):
        signs = [
            Sign(
                f"s{k}", class_name, lat[k], lon[k], ORIGIN[2], np.eye(3) * 0.04, 0.98, 9, 0, 0,
                2.0, turn if k == 3 else 0.0, 0.6, "", existence=0.99,
                facing_sd_rad=float(sd if k == 3 else np.radians(8.0)),
            )
            for k in range(8)
        ]  # fmt: skip
        listed = Inventory(
            tuple(f"i{k}" for k in range(8)), (class_name,) * 8, lat, lon, np.zeros(8),
            np.full(8, 0.2),
        )  # fmt: skip
        told = compare_inventory(signs, listed, [])
        assert sum(f.kind == "matched" for f in told.findings) == matched


def test_one_pair_of_a_class_tells_half_of_its_distance() -> None:
    """Of twelve pairs at as many distances one is of a class: there it is half as sure as it looks,
    and elsewhere as likely as half of them all say."""
    n = 12
    first = np.column_stack([80.0 * np.arange(n), np.zeros(n)])
    second = first + np.column_stack([np.zeros(n), 1.25 + np.arange(n)])
    lat, lon, _ = from_local_ned(
        np.column_stack([np.vstack([first, second]), np.zeros(2 * n)]), ORIGIN
    )
    names = [LIMITS[0]] * n + [LIMITS[0] if k == 6 else LIMITS[1] for k in range(n)]
    none = np.full(2 * n, np.nan)
    same, another, unknown = neighbours_of(Inventory([""] * 2 * n, names, lat, lon, none, none))
    same, another = same.sum(axis=1), another.sum(axis=1)
    assert np.isclose(same.sum(), 1.0 / n)
    of_class = (same / np.maximum(same + another, 1e-9))[same + another > 0.0]
    assert np.isclose(of_class.max(), 0.5 * (1.0 + 1.0 / n))
    np.testing.assert_allclose(np.sort(of_class)[:-1], 0.5 / n)
    assert not unknown.any()
