"""Signs that were not seen when they should have been."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from geolocation_scene import boxes, camera, drive_path, roadside

from automap.geolocation.due_frames import usual_heights
from automap.geolocation.existence import _by_scores, _correlation, existence_of
from automap.geolocation.face_sizes import largest_face_m, size_nats
from automap.geolocation.landmark import SizePrior
from automap.geolocation.limits import SCORE_CORRELATION
from automap.geolocation.locate import locate_signs
from automap.geolocation.result import GeolocationResult
from automap.geolocation.rules import GeolocationRules
from automap.records import Detections, IntArray, Trajectory


def drive() -> tuple[Trajectory, Detections, IntArray]:
    path = drive_path(60.0)
    found, owner = boxes(path, roadside(path), camera(), np.random.default_rng(2))
    return path, found, owner


def located(
    path: Trajectory, found: Detections, kept: np.ndarray, rules: GeolocationRules | None = None
) -> GeolocationResult:
    some = {name: getattr(found, name)[kept] for name in ("frame", "t_ns", "class_name", "box")}
    some |= {name: getattr(found, name)[kept] for name in ("score", "track")}
    return locate_signs(path, [replace(found, **some)], {"front": camera()}, rules)


def test_a_sign_that_a_lorry_hides_for_the_rest_of_its_pass_stays() -> None:
    path, found, owner = drive()
    rows = np.flatnonzero(owner == 4)
    kept = np.ones(len(found), np.bool_)
    kept[rows[4:]] = False
    result = located(path, found, kept)
    assert len(result.signs) == len(np.unique(owner))


def test_what_is_found_now_and_then_where_signs_are_found_in_each_frame_is_none() -> None:
    """Six boxes that fit one place as a sign's do, of some thirty frames that should show it."""
    path = drive_path(30.0)
    found, owner = boxes(path, roadside(path), camera(), np.random.default_rng(2), interval_s=0.1)
    plain = GeolocationRules(estimate_camera=False, estimate_noise=False)
    rows = np.flatnonzero(owner == 4)
    assert len(rows) > 30
    for some, more in ((rows[[0, 3, 9, 16, 24, 30]], 0), (rows[:6], 1)):
        kept = np.ones(len(found), np.bool_)
        kept[np.setdiff1d(rows, some)] = False
        result = located(path, found, kept, plain)
        assert len(result.signs) == len(np.unique(owner)) - 1 + more


def test_a_thing_that_looks_like_a_sign_does_so_in_every_pass() -> None:
    sure, doubted = [9.0, 1e20], [999.0, 1.0]
    assert existence_of([sure]) == pytest.approx(0.9)
    assert existence_of([sure, sure]) == pytest.approx(0.99)
    # a sign, such a thing or boxes that meet by chance: one of the three
    assert existence_of([doubted]) == pytest.approx(1.0 / (2.0 + 1.0 / 999.0))
    assert existence_of([doubted, doubted]) == pytest.approx(0.5, abs=1e-5)
    assert existence_of([[999.0, 9.0], doubted]) == pytest.approx(5.0 / 6.0, abs=1e-5)
    # however sure each of many passes is
    assert existence_of([[1e20, 1e20]] * 40) == pytest.approx(1.0)


@pytest.mark.slow
def test_a_single_box_before_many_frames_without_one_is_no_sign() -> None:
    path, found, owner = drive()
    rows = np.flatnonzero(owner == 4)
    kept = np.ones(len(found), np.bool_)
    kept[rows[1:]] = False
    result = located(path, found, kept)
    assert len(result.signs) == len(np.unique(owner)) - 1
    assert "unconfirmed" in result.observations.note.tolist()


@pytest.mark.slow
def test_a_wall_that_is_seen_again_and_again_is_no_warning() -> None:
    path = drive_path(40.0)
    scene = roadside(path)
    size = scene.size_m.copy()
    size[4], size[7] = 5.0, 2.0
    names = tuple("warning--children--g2" for _ in size)
    placed = replace(scene, size_m=size, class_name=names)
    found, owner = boxes(path, placed, camera(), np.random.default_rng(2))
    assert (owner == 4).sum() > 5
    signs = locate_signs(path, [found], {"front": camera()}).signs
    sizes = np.array([sign.size_m for sign in signs])
    # a face of three times the usual size stays
    assert len(signs) == len(size) - 1
    assert sizes.max() == pytest.approx(2.0, rel=0.1)
    # nor does any size that is made make a sign doubtful
    assert min(sign.existence for sign in signs) > 0.99
    # beyond what boxes with a score of 0.9 leave open
    assert np.median([sign.existence for sign in signs]) > 0.995
    # boards are as large as what stands on them
    assert largest_face_m("information--unknown-green-square") == np.inf


def test_sizes_tell_faces_from_other_things() -> None:
    usual = SizePrior(0.75, 0.25)
    nats = [size_nats(np.log(size), 0.05**2, usual, 2.4) for size in (0.75, 2.0, 2.4, 3.0, 8.0)]
    # of any size that is made, and about the usual with a density of 1 / (0.25 sqrt(2 pi)); larger
    # things as often of one size as of another, half of those measured at the limit
    odd, larger = 2.0 / 3.0 / np.log(12.0), 1.0 / np.log(10.0 / 2.4)
    assert nats[0] > 10.0
    assert nats[1] > 7.0
    assert nats[2] == pytest.approx(np.log(odd / larger), abs=0.05)
    assert max(nats[3:]) < -8.0
    # nothing is told by a size that nobody measured
    assert abs(size_nats(0.0, 1e4, usual, 2.4)) < 0.05


def test_scores_of_one_thing_count_as_often_as_they_differ() -> None:
    """The best of many scores is high of anything; their mean says as much as one, or more where
    a thing's scores scatter as much as those of all things."""
    rng = np.random.default_rng(3)
    levels = rng.uniform(0.5, 0.95, 40)
    alike = [np.full(15, level) for level in levels]
    apart = [rng.permutation(levels)[:15] for _ in levels]
    assert _correlation(alike) == 1.0
    assert _correlation(apart) == SCORE_CORRELATION
    assert _correlation(alike[:1]) == 1.0
    one = np.full(15, 0.7)
    assert _by_scores(one, 1.0) == pytest.approx(np.log(0.7 / 0.3))
    best = np.append(np.full(14, 0.3), 0.9)
    assert _by_scores(best, 1.0) < -0.5
    # four views are the most, and no detector is surer than 0.99
    assert _by_scores(one, SCORE_CORRELATION) == pytest.approx(np.log(0.7 / 0.3) * 15.0 / 4.5)
    assert _by_scores(np.full(15, 0.95), SCORE_CORRELATION) == pytest.approx(np.log(99.0))


@pytest.mark.parametrize(("grows", "usual"), [(True, 0.01), (False, 0.06)])
def test_from_which_height_on_signs_are_found_what_does_not_grow_does_not_tell(
    grows: bool, usual: float
) -> None:
    """Three signs that are driven towards, and four pieces of a reflex; unless nothing grows."""
    n = 6
    growing = np.linspace(0.01, 0.03, n) if grows else np.full(n, 0.01)
    heights = np.concatenate([*[growing] * 3, *[np.full(n, 0.06)] * 4])
    views = SimpleNamespace(
        camera_names=("front",),
        camera=np.zeros(len(heights), np.int64),
        t_ns=np.arange(len(heights)),
        measured=np.column_stack([0.0 * heights, 0.0 * heights, np.log(heights)]),
    )
    marks = [SimpleNamespace(rows=np.arange(k, k + n)) for k in range(0, len(heights), n)]
    found = usual_heights(views, marks)  # type: ignore[arg-type]
    assert found == pytest.approx([usual])
