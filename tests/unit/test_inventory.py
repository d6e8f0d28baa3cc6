"""A map against an inventory made from the truth, with known faults put into it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from inventory_case import KINDS, faulty, judged, merged_town, town_and_drive
from merge_scene import USUAL, to_geodetic

from automap.earth import metres_per_radian
from automap.inventory.comparison import compare_inventory
from automap.inventory.findings import (
    Finding,
    Inventory,
    class_belief,
    mark_sure,
    new_signs,
)
from automap.inventory.missing import counts, standing
from automap.inventory.pairs import Fit, left_out_odds
from automap.io.atomic import write_json
from automap.io.map_tables import write_sightings
from automap.mapping.visibility import Opportunities
from automap.records import Sign, Trajectory
from pipeline.compare.command import _left_out
from pipeline.merge.inputs import even_path


@pytest.mark.slow
def test_faults_put_into_an_inventory_are_found() -> None:
    """By three merged drives that overlook, misread and imagine signs: of each kind that is told
    for sure, and of each that is due, nine of ten. That nothing hides any of 160 signs nobody can
    be sure of, so that those that are gone are called so and not for work; without frames they
    are not even called so."""
    total = {kind: np.zeros(3) for kind in KINDS}
    for seed in range(3):
        rng, town, drives, truth, signs = merged_town(seed, 3, 4000.0, USUAL)
        case = faulty(rng, town)
        result = compare_inventory(signs, case.inventory, drives)
        for kind, score in judged(result, case, truth, sure=True).items():
            if kind != "missing":
                total[kind] += score
        total["missing"] += judged(result, case, truth)["missing"]
    blind = [replace(s, n_looked=0, seen_share=float("nan")) for s in signs]
    findings = compare_inventory(blind, case.inventory, drives).findings
    assert not [f for f in findings if f.kind == "missing"]
    for kind, (right, told, due) in total.items():
        assert due > 10, kind
        # of some twenty, one by chance
        assert right > 0.9 * told - 1.0, (kind, total[kind])
        assert right > 0.9 * due - 1.0, (kind, total[kind])


def test_one_drive_says_less_but_nothing_false() -> None:
    """Nor does it hold back what it knows: of new signs and other classes, four of five."""
    right = told = due = 0
    for seed in range(3):
        rng, town, drives, truth, signs = town_and_drive(seed, 4000.0, USUAL)
        case = faulty(rng, town)
        result = compare_inventory(signs, case.inventory, drives)
        # seen once, a sign may be gone or have been overlooked
        assert {f.kind for f in result.findings if f.sign < 0} <= {"unconfirmed", "not_seen"}
        score = judged(result, case, truth, sure=True)
        right += sum(score[kind][0] for kind in KINDS if kind != "matched")
        told += sum(score[kind][1] for kind in KINDS if kind != "matched")
        due += sum(score[kind][2] for kind in ("new", "class", "moved"))
        lost = [f for f in result.findings if f.kind == "unconfirmed"]
        # nor would more drives tell: what hides one from all of them is not known
        assert {f.more_drives for f in lost} == {0}
    assert told > 20
    assert right > 0.88 * told
    assert right > 0.8 * due


def test_what_is_for_work_is_right_nine_times_of_ten_and_never_less_likely_than_not() -> None:
    def sure(*told: float) -> list[bool]:
        return [f.sure for f in mark_sure([Finding("new", k, -1, p) for k, p in enumerate(told)])]

    assert sure(0.99, 0.82, 0.98) == [True, True, True]  # 2.79 of 3 are expected to be right
    assert sure(0.7, 0.99, 0.95) == [False, True, True]  # 2.64 would be
    assert sure(*[0.999] * 9, 0.4) == [True] * 9 + [False]
    assert sure(0.89) == [False]
    # what is hidden from all drives is unknown of all signs at once: the surer do not lend
    gone = mark_sure([Finding("missing", -1, k, p) for k, p in enumerate((0.97, 0.85, 0.96, 0.85))])
    assert [f.sure for f in gone] == [True, False, True, False]
    # one kind does not lend to another
    both = mark_sure([Finding("new", 0, -1, 0.99), Finding("class", 1, 1, 0.85)])
    assert [f.sure for f in both] == [True, False]


def test_a_sign_that_may_be_a_moved_and_misread_one_is_not_surely_new() -> None:
    """It stands 8 m from a listed sign that nobody found, and shows something else."""
    rng, town, drives, truth, signs = town_and_drive(4, 2000.0)
    case = faulty(rng, town)
    result = compare_inventory(signs, case.inventory, drives)
    moved = next(f for f in result.findings if f.kind == "moved")
    shown = signs[moved.sign].class_name
    other = next(c for c in (signs[0].class_name, "regulatory--stop--g1") if c != shown)
    misread = [replace(s, class_name=other) if s is signs[moved.sign] else s for s in signs]
    result = compare_inventory(misread, case.inventory, drives)
    by_sign = {f.sign: f for f in result.findings}
    assert by_sign[moved.sign].kind == "new"
    deleted = [f for f in result.findings if f.kind == "new" and f.sign != moved.sign]
    assert all(f.probability > 0.95 for f in deleted)
    assert by_sign[moved.sign].probability < 0.9
    assert len(truth) == len(signs)


def test_a_sign_that_is_not_listed_is_doubted_the_more_the_fuller_the_list_is() -> None:
    def probability(listed: int) -> float:
        signs = [sign_at(k, 0.97) for k in range(listed + 1)]
        return new_signs(signs, np.array([listed]))[0].probability

    full, sparse = probability(2000), probability(2)
    assert full < 0.7 < sparse
    # and one that the map is sure of is believed in any case
    sure = [sign_at(k, 0.999) for k in range(64)]
    assert all(f.probability > 0.98 for f in new_signs(sure, np.arange(4)))


def test_a_map_that_believes_too_much_is_found_out_by_the_list() -> None:
    """Of its signs believed to 0.6 one in ten is listed, of the others nearly all."""
    signs = [sign_at(k, 0.998) for k in range(200)] + [sign_at(k, 0.6) for k in range(200, 220)]
    unknown = np.r_[np.arange(10), np.arange(202, 220)]
    told = [f.probability for f in new_signs(signs, unknown)]
    assert min(told[:10]) > 0.9
    # two of twenty are listed, and of twenty real ones nineteen would be
    assert max(told[10:]) < 0.2


@pytest.mark.parametrize(("signs", "listed"), [(18, 2), (400, 20)])
@pytest.mark.parametrize("belief", [0.9, 0.99])
def test_a_list_that_lacks_nearly_all_is_no_reason_to_doubt_the_map(
    signs: int, listed: int, belief: float
) -> None:
    there = [sign_at(k, belief) for k in range(signs)]
    told = new_signs(there, np.arange(listed, signs))
    assert min(f.probability for f in told) > 0.85


def test_a_sign_that_may_stand_far_from_where_it_is_on_the_map_is_not_surely_new() -> None:
    """Its entry may stand further off than entries are looked for."""
    there = [sign_at(k, 0.999) for k in range(64)]
    there[0] = replace(there[0], cov_enu=np.diag([84.0, 25.0, 2.0]) ** 2)
    told = [f.probability for f in new_signs(there, np.arange(4))]
    assert told[0] < 0.1
    assert min(told[1:]) > 0.98


def sign_at(number: int, exists: float) -> Sign:
    return Sign(
        f"s{number}", "a", 0.0, 0.0, 0.0, np.eye(3), exists, 9, 0, 0, 2.0, 0.0, 0.6, "",
        existence=exists,
    )  # fmt: skip


def test_a_sign_that_a_reviewer_added_has_no_belief_and_takes_none_from_the_others() -> None:
    """Its unknown belief had made every sign of the map unknown."""
    rng, town, drives, _, signs = town_and_drive(11, 600.0)
    listed = faulty(rng, town).inventory
    far = {"lat_rad": signs[0].lat_rad + 1e-4, "existence": np.nan, "confidence": np.nan}
    added = replace(signs[0], id="r1", status="added", reviewed="2026-11-30T08:00:00Z", **far)
    without = compare_inventory(signs, listed, drives).findings
    found = compare_inventory([*signs, added], listed, drives).findings
    assert {f.listed: f.sign for f in found if f.sign != len(signs)} == {
        f.listed: f.sign for f in without
    }
    own = next(f for f in found if f.sign == len(signs))
    assert (own.kind, own.sure) == ("new", True)


def test_two_drives_of_three_that_agree_are_surer_than_two_thirds() -> None:
    alone = replace(sign_at(0, 0.99), confidence=0.66)
    assert class_belief(alone) == pytest.approx(0.66 / 0.99)
    three = replace(alone, drives=("a", "b", "c"))
    assert 0.9 < class_belief(three) < 0.999
    against = replace(three, confidence=0.33)
    assert class_belief(against) < 0.1


def test_the_inventorys_shift_and_accuracy_come_from_the_data() -> None:
    rng, town, drives, _, signs = town_and_drive(11)
    case = faulty(rng, town, sd=0.8, shift=(1.6, -1.1))
    result = compare_inventory(signs, case.inventory, drives)
    # found minus listed is the opposite of what the list is off, up to the drive's own 0.55 m
    assert np.hypot(*(result.shift_m - [-1.6, 1.1])) < 1.0
    assert 0.6 < result.sd_m < 1.1


def test_accuracy_that_an_inventory_states_decides_what_has_moved() -> None:
    rng, town, drives, _, signs = town_and_drive(5)
    inventory = faulty(rng, town).inventory
    moved = []
    for sd in (0.3, 5.0):
        stated = replace(inventory, sd_m=np.full(len(inventory), sd))
        result = compare_inventory(signs, stated, drives)
        moved.append(sum(f.kind == "moved" for f in result.findings))
    assert moved[0] > 8
    assert moved[1] < moved[0] / 4


def test_directions_of_traffic_are_noticed() -> None:
    rng, town, drives, _, signs = town_and_drive(6)
    inventory = faulty(rng, town).inventory
    straight = compare_inventory(signs, inventory, drives)
    inventory = replace(inventory, facing_rad=inventory.facing_rad + np.pi)
    turned = compare_inventory(signs, inventory, drives)
    assert not straight.directions.turned
    assert turned.directions.turned
    assert [f.kind for f in turned.findings] == [f.kind for f in straight.findings]


def test_a_sign_that_no_drive_had_in_view_is_not_missing() -> None:
    _, town, drives, _, signs = town_and_drive(7)
    lat, lon, _ = to_geodetic(town.position + np.array([400.0, 0.0, 0.0]))
    n = len(lat)
    inventory = Inventory(
        [str(k) for k in range(n)], [""] * n, lat, lon, np.full(n, np.nan), np.full(n, np.nan)
    )
    kinds = {f.kind for f in compare_inventory(signs, inventory, drives).findings}
    assert kinds == {"new", "not_seen"}


def test_what_was_not_found_is_weighed_by_how_often_its_kind_was_found() -> None:
    """Signs passed by one to four drives of which each sees a standing one at a rate of its own:
    of those called gone with probability p the part p is."""
    rng = np.random.default_rng(4)
    stated, true = [], []
    for _ in range(6):
        n = 3000
        tries = rng.integers(0, 5, n)
        there = rng.random(n) > 0.05
        rate = rng.beta(6.0 * 0.85, 6.0 * 0.15, n)
        hits = np.where(there, rng.binomial(tries, rate), 0)
        known = standing(tries, hits, np.zeros(n, np.int64))
        assert np.isnan(known.gone[tries == 0]).all()
        assert (known.gone[hits > 0] == 0.0).all()
        assert known.rate == pytest.approx(0.85, abs=0.04)
        many = (hits == 0) & (tries > 1)
        stated.append(known.gone[many])
        true.append(~there[many])
    p, gone = np.concatenate(stated), np.concatenate(true)
    for low, high in ((0.0, 0.75), (0.75, 0.9), (0.9, 1.0)):
        part = (p >= low) & (p < high)
        assert part.sum() > 100
        assert gone[part].mean() == pytest.approx(p[part].mean(), abs=0.07)


def test_a_glimpse_is_no_look() -> None:
    """Of signs in view from a few metres alone nothing is known, so that a miss says little."""
    tries, hits = np.full(60, 3), np.full(60, 3)
    hits[[0, 59]] = 0
    group = np.zeros(60, np.int64)
    group[-3:] = 1
    known = standing(tries, hits, group, [(8.0, 1.5), (1.0, 1.0)])
    assert known.gone[0] > 0.9
    assert known.gone[59] < 0.7
    assert known.more_drives[0] == 0 < known.more_drives[59]
    # so many more that miss it, and not one less, make it surely gone
    more = int(known.more_drives[59])
    for number, least in ((more - 1, False), (more, True)):
        passed = tries.copy()
        passed[59] += number
        # further misses tell a little of the others' rate too
        gone = standing(passed, hits, group, [(8.0, 1.5), (1.0, 1.0)]).gone[59]
        assert (gone > 0.88) == least or abs(gone - 0.9) < 0.03


def test_a_slow_drive_has_a_sign_in_view_no_longer_than_a_fast_one() -> None:
    way = np.concatenate(
        [np.arange(0.0, 50.0, 0.5), np.full(200, 50.0), np.arange(50.0, 101.0, 25)]
    )
    lat, lon, height = to_geodetic(np.column_stack([0.0 * way, way, 0.0 * way]))
    three = np.zeros((len(way), 3))
    stamps = np.arange(len(way), dtype=np.int64)
    path = even_path(
        Trajectory(stamps, stamps * 1.0, lat, lon, height, three, three, three, three, three)
    )
    assert len(path) == 26
    assert np.diff(path.lat_rad)[:-1] * 6.36e6 == pytest.approx(4.0, abs=0.05)


def test_signs_of_unknown_facing_have_rates_of_their_own() -> None:
    tries = np.full(90, 2)
    hits = np.full(90, 2)
    group = np.repeat([0, 1, 2], 30)
    # those on the left look away from every drive, half of the time
    hits[30:45] = 0
    hits[0] = hits[60] = 0
    gone = standing(tries, hits, group).gone
    assert gone[0] > 0.8
    assert gone[60] == pytest.approx(gone[0], abs=0.05)
    assert gone[30] < gone[0] - 0.15


def test_drives_that_had_a_sign_in_view_are_counted() -> None:
    sign, drive = np.array([0, 0, 1, 1, 2]), np.array([0, 1, 0, 1, 0])
    none = np.zeros(5)
    seen_by = [frozenset({1}), None, frozenset({5}), frozenset({0})]
    tries, hits = counts(Opportunities(sign, drive, none, none, sign), 4, seen_by)
    assert tries.tolist() == [2, 2, 1, 0]
    # a sign that was found was seen, whoever of those in view it was
    assert hits.tolist() == [1, 0, 1, 0]


def test_what_all_signs_of_a_map_are_off_in_common_is_no_doubt_of_one_that_was_moved() -> None:
    """A map that is off by some metres as a whole states that of each of its signs."""
    rng, town, drives, _, signs = town_and_drive(5)
    case = faulty(rng, town)
    wide = [replace(s, cov_enu=s.cov_enu + 2.5**2 * np.eye(3)) for s in signs]
    moved = set(np.flatnonzero(case.kind == "moved").tolist())
    result = compare_inventory(wide, case.inventory, drives)
    told = {f.listed for f in result.findings if f.kind == "moved" and f.sure}
    assert len(told & moved) > 0.9 * len(moved) - 1
    assert len(told & moved) > 0.9 * len(told) - 1
    assert np.median([f.sd_m for f in result.findings if f.kind == "matched"]) < 1.5


def test_a_pair_is_doubted_where_another_pairing_explains_as_much() -> None:
    """Two signs on one corner and one entry between them that may be either of them."""

    def at(number: int, east_m: float) -> Sign:
        there = sign_at(number, 0.999)
        return replace(there, lon_rad=east_m / 6.378e6, cov_enu=0.25 * np.eye(3))

    names = ["regulatory--stop--g1"] * 12
    far = [replace(at(k, 0.0), lat_rad=k * 1e-5) for k in range(1, 11)]
    signs = [replace(s, class_name=names[0]) for s in [*far, at(11, -0.6), at(12, 0.6)]]
    signs[-2:] = [replace(s, class_name="regulatory--yield--g1") for s in signs[-2:]]
    place = [(s.lat_rad, s.lon_rad) for s in far] + [(0.0, 0.0)]
    n = len(place)
    inventory = Inventory(
        [str(k) for k in range(n)], [*names[:10], "regulatory--yield--g1"],
        np.array([p[0] for p in place]), np.array([p[1] for p in place]),
        np.full(n, np.nan), np.full(n, np.nan),
    )  # fmt: skip
    findings = compare_inventory(signs, inventory, []).findings
    between = next(f for f in findings if f.listed == n - 1)
    other = next(f for f in findings if f.kind == "new")
    assert between.probability == pytest.approx(0.5, abs=0.05)
    assert other.probability == pytest.approx(0.5, abs=0.1)
    assert min(f.probability for f in findings if f not in (between, other)) > 0.95


def test_what_a_drive_saw_and_the_map_leaves_out_speaks_for_a_listed_sign(
    tmp_path: Path,
) -> None:
    """Of three drives one sees a sign, and the merged map takes it for clutter. The first is off by
    5 m there, which is taken off; what is on the map is not among these."""
    name, lat = "regulatory--stop--g1", np.array([0.6, 0.6, 0.7])
    listed = Inventory([*"abc"], [name] * 3, lat, np.zeros(3), *np.full((2, 3), np.nan))
    zero = np.zeros(2)
    write_json(tmp_path / "merge.json", {})
    write_sightings(
        tmp_path / "sightings.parquet",
        {
            "key": ["one", "two"], "drive": ["x", "x"], "drive_sign": ["1", "2"],
            "class": [name, name], "sign_id": ["", "on the map"],
        },
        {
            "lat_deg": np.degrees([0.6, 0.7]), "lon_deg": zero, "existence": np.array([0.1, 0.9]),
            "offset_e_m": zero + 5.0, "offset_n_m": zero - 5.0,
        },
    )  # fmt: skip
    warnings: list[str] = []
    left_out = _left_out(tmp_path, warnings)
    assert not warnings
    assert [s.id for s in left_out] == ["one"]
    per_lat, per_lon = (float(v) for v in metres_per_radian(0.6, 0.0))
    assert (left_out[0].lat_rad - 0.6) * per_lat == pytest.approx(5.0)
    assert left_out[0].lon_rad * per_lon == pytest.approx(-5.0)
    shift, none = np.array([-5.0, 5.0]), np.zeros(0)
    known = Fit(shift, 0.3, none, none, none, none, np.nan)
    near = left_out_odds(left_out, listed, known, True)
    assert near[0] > 3.0
    assert near[2] == 0.0
    # the surer that there was something, the more; of another class hardly
    surer = [replace(s, existence=0.4) for s in left_out]
    assert left_out_odds(surer, listed, known, True)[0] > 3.0 * near[0]
    other = [replace(s, class_name="warning--children--g2") for s in left_out]
    assert left_out_odds(other, listed, known, True)[0] < 0.5 * near[0]
    assert left_out_odds([], listed, known, True).tolist() == [0.0, 0.0, 0.0]
    (tmp_path / "sightings.parquet").write_bytes(b"cut")
    assert _left_out(tmp_path, warnings) == []
    assert len(warnings) == 1


def test_a_listed_sign_beside_what_the_map_leaves_out_is_not_held_for_gone() -> None:
    _, town, drives, truth, signs = town_and_drive(7, 600.0)
    lat, lon, _ = to_geodetic(town.position)
    inventory = Inventory(
        [str(k) for k in range(len(lat))], town.class_name.tolist(), lat, lon, town.facing,
        np.full(len(lat), 0.3),
    )  # fmt: skip
    place = int(truth[0])

    def gone(left_out: list[Sign]) -> float:
        found = compare_inventory(signs[1:], inventory, drives, left_out=left_out).findings
        assert all(f.sign < len(signs) - 1 for f in found)
        told = next(f for f in found if f.listed == place)
        assert told.kind in ("missing", "unconfirmed")
        return told.probability if told.kind == "missing" else 1.0 - told.probability

    unlikely = replace(signs[0], existence=0.2)
    far = replace(unlikely, lat_rad=unlikely.lat_rad + 1e-4)
    assert gone([unlikely]) < 0.3 * gone([])
    assert gone([far]) == gone([])
