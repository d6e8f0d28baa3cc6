"""What boxes tell of a sign's condition: contrast of its face, and how often it was seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from geolocation_scene import boxes, camera, drive_path, roadside

from automap.geolocation.condition import face_of_views
from automap.geolocation.locate import locate_signs
from automap.geolocation.rules import GeolocationRules
from automap.records import Detections, Looked, Sign

PATH = drive_path(25.0)
PLAIN = GeolocationRules(estimate_camera=False, estimate_noise=False)


def signs_of(found: Detections) -> list[Sign]:
    return locate_signs(PATH, [found], {"front": camera()}, PLAIN).signs


def looked_at(found: Detections, region: tuple[float, ...] = (0.0, 0.0, 1280.0, 720.0)) -> Looked:
    frame = np.arange(int(found.frame.max()) + 1)
    return Looked(frame, np.tile(region, (len(frame), 1)))


def some(found: Detections, keep: np.ndarray) -> Detections:
    names = ("frame", "t_ns", "class_name", "box", "score", "track")
    return replace(found, **{name: getattr(found, name)[keep] for name in names})


@pytest.fixture(scope="module")
def scene() -> tuple[Detections, np.ndarray]:
    return boxes(PATH, roadside(PATH), camera(), np.random.default_rng(0))


def test_a_sign_in_every_frame_was_seen_whenever_looked_at(
    scene: tuple[Detections, np.ndarray],
) -> None:
    found, _ = scene
    signs = signs_of(replace(found, looked=looked_at(found)))
    assert min(sign.n_looked for sign in signs) >= 5
    assert np.mean([sign.seen_share for sign in signs]) > 0.97


def test_frames_that_something_hides_lower_the_share_of_that_sign_alone(
    scene: tuple[Detections, np.ndarray],
) -> None:
    found, owner = scene
    rows = np.flatnonzero(owner == 3)
    # hidden but for the first two and the last two of its frames
    keep = np.setdiff1d(np.arange(len(found)), rows[2:-2])
    whole = signs_of(replace(found, looked=looked_at(found)))
    signs = signs_of(replace(some(found, keep), looked=looked_at(found)))
    shares = {s.id: s.seen_share for s in signs}
    low = min(shares, key=lambda name: shares[name])
    assert shares[low] == pytest.approx(4 / len(rows), abs=0.15)
    assert sorted(shares.values())[1] > 0.9
    assert len(signs) == len(whole)


def test_without_the_frames_that_were_searched_nothing_is_said(
    scene: tuple[Detections, np.ndarray],
) -> None:
    found, _ = scene
    for sign in signs_of(found):
        assert np.isnan(sign.seen_share)
        assert sign.n_looked == 0
        assert sign.contrast_note == ""


def test_frames_of_which_another_part_was_searched_do_not_count(
    scene: tuple[Detections, np.ndarray],
) -> None:
    found, _ = scene
    signs = signs_of(replace(found, looked=looked_at(found, (0.0, 700.0, 1280.0, 720.0))))
    assert [sign.n_looked for sign in signs] == [0] * len(signs)


def test_contrast_is_the_median_of_the_large_views_with_their_scatter() -> None:
    nan = np.nan
    height = np.array([10.0, 20.0, 36.0, 40.0, 60.0])
    why = ["too small", "too small", "", "", ""]
    value, sd, note = face_of_views(np.array([nan, nan, 0.6, 0.7, 0.8]), why, height)
    assert (value, note) == (pytest.approx(0.7), "")
    assert sd == pytest.approx(0.1)
    # a view less than half as large does not count, and two are too few
    value, _, note = face_of_views(
        np.array([nan, 0.1, 0.6, nan, 0.8]), ["too small", "", "", "too bright", ""], height
    )
    assert np.isnan(value)
    assert note == "too few views"


@pytest.mark.parametrize(
    ("notes", "note"),
    [
        (["too small"] * 3, "too small"),
        (["too small", "too small", "too dark"], "too dark"),
        (["", "", ""], ""),
    ],
)
def test_why_no_contrast_is_known(notes: list[str], note: str) -> None:
    value, sd, why = face_of_views(np.full(3, np.nan), notes, np.array([9.0, 18.0, 36.0]))
    assert np.isnan([value, sd]).all()
    assert why == note
