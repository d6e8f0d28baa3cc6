"""What a map sign inherits, against sums written out in plain Python."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from merge_scene import Errors, Scene, street_scene

from automap.mapping.attributes import _change_point, combine_attributes
from automap.mapping.limits import ALTERNATIVES, CHANGED, CLASS_RIGHT, LEAST_CONFIDENCE
from automap.mapping.sightings import DriveSigns, Sightings, stack_sightings


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Three drives whose columns are all of different numbers, some of them unknown."""
    scene = street_scene(3, 3, 700.0, errors=Errors(clutter=0.0), both_ways=False)
    rng = np.random.default_rng(5)

    def some(values: np.ndarray) -> np.ndarray:
        return np.where(rng.random(len(values)) < 0.2, np.nan, values)

    for k, drive in enumerate(scene.drives):
        n = len(drive)
        scene.drives[k] = replace(
            drive,
            height_above_road_m=some(rng.uniform(1.0, 4.0, n)),
            sd_above_road_m=some(rng.uniform(0.05, 0.5, n)),
            facing_rad=some(drive.facing_rad + rng.normal(0.0, 0.4, n)),
            facing_sd_rad=rng.uniform(0.05, 0.4, n),
            size_m=some(rng.uniform(0.3, 1.2, n)),
            n_views=rng.integers(0, 9, n),
            first_gps_s=some(drive.first_gps_s),
            last_gps_s=some(drive.last_gps_s),
            confidence=rng.uniform(0.0, 1.0, n),
            side=rng.choice(np.array(["left", "right", ""], object), n),
            path_offset_m=some(rng.uniform(-6.0, 6.0, n)),
            contrast=some(rng.uniform(0.0, 1.0, n)),
            contrast_sd=rng.uniform(0.0, 0.1, n),
            contrast_note=rng.choice(np.array(["too dark", "too small"], object), n),
            seen_share=some(rng.uniform(0.0, 1.0, n)),
            n_looked=rng.integers(1, 20, n).astype(np.float64),
            status=rng.choice(np.array(["ok", "weak", "implausible"], object), n),
        )
    return scene


def stacked(scene: Scene) -> tuple[Sightings, np.ndarray, list[list[tuple[int, int]]]]:
    """Sightings, the sign of each by the truth, and the sightings of each sign."""
    sightings = stack_sightings(scene.drives)
    truth = np.concatenate(
        [
            own[sightings.row[sightings.first[k] : sightings.first[k + 1]]]
            for k, own in enumerate(scene.truth)
        ]
    )
    sign = np.unique(truth, return_inverse=True)[1].astype(np.int64)
    members: list[list[tuple[int, int]]] = [[] for _ in range(int(sign.max()) + 1)]
    for place, number in enumerate(sign.tolist()):
        members[number].append((place, int(sightings.drive[place])))
    return sightings, sign, members


def weighted(pairs: list[tuple[float, float]]) -> float:
    known = [(v, w) for v, w in pairs if not math.isnan(v)]
    total = sum(w for _, w in known)
    return sum(v * w for v, w in known) / total if total else math.nan


def test_every_column_is_the_sum_that_it_says(scene: Scene) -> None:
    sightings, sign, members = stacked(scene)
    found = combine_attributes(sightings, sign)

    def of(drive: int, place: int, name: str) -> float:
        return float(getattr(scene.drives[drive], name)[sightings.row[place]])

    assert len(members) > 8
    for k, own in enumerate(members):
        views = [(d, p, max(of(d, p, "n_views"), 1.0)) for p, d in own]
        assert found.n_views[k] == sum(of(d, p, "n_views") for d, p, _ in views)
        times = [of(d, p, "first_gps_s") for d, p, _ in views]
        times = [t for t in times if not math.isnan(t)]
        assert found.first_gps_s[k] == min(times) if times else math.isnan(found.first_gps_s[k])
        times = [of(d, p, "last_gps_s") for d, p, _ in views]
        times = [t for t in times if not math.isnan(t)]
        assert found.last_gps_s[k] == max(times) if times else math.isnan(found.last_gps_s[k])
        up = [1.0 / sightings.own_u[p] for _, p, _ in views]
        height = [of(d, p, "height_above_road_m") for d, p, _ in views]
        expected = weighted(list(zip(height, up, strict=True)))
        assert found.height_above_road_m[k] == pytest.approx(expected, nan_ok=True)
        variance = [of(d, p, "sd_above_road_m") ** 2 for d, p, _ in views]
        expected = math.sqrt(weighted(list(zip(variance, up, strict=True))))
        assert found.sd_above_road_m[k] == pytest.approx(expected, nan_ok=True)
        faces = [(of(d, p, "facing_rad"), of(d, p, "facing_sd_rad")) for d, p, _ in views]
        faces = [(f, s) for f, s in faces if not math.isnan(f)]
        if faces:
            mean = sum(complex(math.cos(f), math.sin(f)) / s**2 for f, s in faces)
            turn = abs(np.angle(np.exp(1j * (found.facing_rad[k] - np.angle(mean)))))
            assert turn < 1e-9
            assert 0.0 <= found.facing_rad[k] < 2.0 * math.pi
            spread = weighted([(s**2, 1.0 / s**2) for _, s in faces])
            assert found.facing_sd_rad[k] == pytest.approx(math.sqrt(spread))
        else:
            assert math.isnan(found.facing_rad[k])
        sizes = [(of(d, p, "size_m"), w) for d, p, w in views]
        logs = [(math.log(v) if v > 0 else math.nan, w) for v, w in sizes]
        assert found.size_m[k] == pytest.approx(math.exp(weighted(logs)), nan_ok=True)
        assert found.drives[k] == tuple(sorted({d for d, _, _ in views}))
        right = [min(max(float(sightings.confidence[p]), 0.0), 0.999) for _, p, _ in views]
        assert found.confidence[k] == pytest.approx(1.0 - math.prod(1.0 - c for c in right))
        votes: dict[str, float] = {}
        for d, p, w in views:
            side = str(scene.drives[d].side[sightings.row[p]])
            if side:
                votes[side] = votes.get(side, 0.0) + w
        assert votes.get(found.side[k], 0.0) == max(votes.values(), default=0.0)


def test_the_status_is_the_best_that_several_drives_allow(scene: Scene) -> None:
    sightings, sign, members = stacked(scene)
    found = combine_attributes(sightings, sign)
    for k, own in enumerate(members):
        states = [str(scene.drives[d].status[sightings.row[p]]) for p, d in own]
        drives = {d for _, d in own}
        if "ok" in states or (len(drives) > 1 and "implausible" not in states):
            assert found.status[k] == "ok"
        else:
            most = max(states.count(s) for s in states)
            assert states.count(found.status[k]) == most


def _single(drive: DriveSigns, confidence: float, class_name: str) -> DriveSigns:
    return replace(
        drive,
        confidence=np.full(len(drive), confidence),
        class_name=np.full(len(drive), class_name, object),
    )


def test_the_class_is_that_of_the_most_belief_and_says_its_share(scene: Scene) -> None:
    votes = [("a", 0.9), ("b", 0.5), ("b", 0.3)]
    drives = [_single(d, c, name) for d, (name, c) in zip(scene.drives, votes, strict=True)]
    sightings, sign, members = stacked(Scene(scene.town, drives, scene.truth))
    found = combine_attributes(sightings, sign)
    seen = 0
    for k, own in enumerate(members):
        belief: dict[str, float] = {}
        for place, drive in own:
            name, confidence = votes[drive]
            assert sightings.classes[sightings.code[place]] == name
            belief[name] = belief.get(name, 0.0) + max(confidence, LEAST_CONFIDENCE)
        best = max(belief, key=belief.__getitem__)
        assert sightings.classes[found.code[k]] == best
        assert found.class_share[k] == pytest.approx(belief[best] / sum(belief.values()))
        seen += len(belief) > 1
    assert seen > 3


def likeliest_change(codes: list[int], classes: int) -> int:
    """By trying every pair of classes and every place of the change."""
    right, wrong = math.log(CLASS_RIGHT), math.log((1.0 - CLASS_RIGHT) / ALTERNATIVES)

    def told(part: list[int], one: int) -> float:
        return sum(right if code == one else wrong for code in part)

    best, at = max(told(codes, one) for one in range(classes)), 0
    for k in range(1, len(codes)):
        for one, two in itertools.permutations(range(classes), 2):
            cost = told(codes[:k], one) + told(codes[k:], two) + math.log(CHANGED)
            if cost > best + 1e-9:
                best, at = cost, k
    return at


def test_a_change_of_class_is_where_the_likelihood_has_it() -> None:
    rng = np.random.default_rng(2)
    changes = 0
    for _ in range(300):
        n, k = int(rng.integers(2, 12)), int(rng.integers(0, 12))
        codes = np.where(np.arange(n) < k, 0, 1)
        codes = np.where(rng.random(n) < 0.15, rng.integers(0, 3, n), codes).astype(np.int64)
        found = _change_point(codes, 3)
        assert found == likeliest_change(codes.tolist(), 3), codes
        changes += found > 0
    assert 50 < changes < 250


def test_condition_is_the_drives_together(scene: Scene) -> None:
    sightings, sign, members = stacked(scene)
    found = combine_attributes(sightings, sign)
    for k, own in enumerate(members):
        rows = [place for place, _ in own]
        told = [(sightings.contrast[r], sightings.contrast_sd[r]) for r in rows]
        told = [(value, sd) for value, sd in told if np.isfinite(value)]
        if told:
            mean = sum(value for value, _ in told) / len(told)
            square = sum(value**2 + sd**2 for value, sd in told) / len(told) - mean**2
            assert found.contrast[k] == pytest.approx(mean)
            assert found.contrast_sd[k] == pytest.approx(math.sqrt(square))
            assert found.contrast_note[k] == ""
        else:
            assert np.isnan(found.contrast[k])
            assert found.contrast_note[k] in {sightings.contrast_note[r] for r in rows}
        aside = [
            (max(int(sightings.n_views[r]), 1), sightings.path_offset_m[r])
            for r in rows
            if sightings.side[r] == found.side[k] and np.isfinite(sightings.path_offset_m[r])
        ]
        if aside:
            offset = sum(n * value for n, value in aside) / sum(n for n, _ in aside)
            assert found.path_offset_m[k] == pytest.approx(offset)
        else:
            assert np.isnan(found.path_offset_m[k])
        assert found.n_looked[k] == sum(sightings.n_looked[r] for r in rows)
        looked = [
            (sightings.n_looked[r], sightings.seen_share[r])
            for r in rows
            if np.isfinite(sightings.seen_share[r])
        ]
        if looked:
            share = sum(n * p for n, p in looked) / sum(n for n, _ in looked)
            assert found.seen_share[k] == pytest.approx(share)


def test_drives_that_tell_no_condition_leave_it_open() -> None:
    plain = stack_sightings(street_scene(3, 2, 300.0).drives)
    found = combine_attributes(plain, np.arange(len(plain)))
    assert np.isnan(found.contrast).all()
    assert set(found.contrast_note) == {""}
    assert not found.n_looked.any()
