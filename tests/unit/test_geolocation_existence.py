"""Signs that were not seen when they should have been."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from geolocation_scene import boxes, camera, drive_path, roadside

from automap.geolocation.locate import locate_signs
from automap.geolocation.result import GeolocationResult
from automap.records import Detections, IntArray, Trajectory


def drive() -> tuple[Trajectory, Detections, IntArray]:
    path = drive_path(60.0)
    found, owner = boxes(path, roadside(path), camera(), np.random.default_rng(2))
    return path, found, owner


def located(path: Trajectory, found: Detections, kept: np.ndarray) -> GeolocationResult:
    some = {name: getattr(found, name)[kept] for name in ("frame", "t_ns", "class_name", "box")}
    some |= {name: getattr(found, name)[kept] for name in ("score", "track")}
    return locate_signs(path, [replace(found, **some)], {"front": camera()})


def test_a_sign_that_a_lorry_hides_for_the_rest_of_its_pass_stays() -> None:
    path, found, owner = drive()
    rows = np.flatnonzero(owner == 4)
    kept = np.ones(len(found), np.bool_)
    kept[rows[4:]] = False
    result = located(path, found, kept)
    assert len(result.signs) == len(np.unique(owner))


def test_a_single_box_before_many_frames_without_one_is_no_sign() -> None:
    path, found, owner = drive()
    rows = np.flatnonzero(owner == 4)
    kept = np.ones(len(found), np.bool_)
    kept[rows[1:]] = False
    result = located(path, found, kept)
    assert len(result.signs) == len(np.unique(owner)) - 1
    assert "unconfirmed" in result.observations.note.tolist()
