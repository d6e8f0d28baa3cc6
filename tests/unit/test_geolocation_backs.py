"""The back of a sign is not another sign."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from geolocation_scene import Scene, boxes, camera, drive_path, roadside

from automap.geolocation.locate import locate_signs
from automap.records import Detections, Trajectory
from automap.signs.backs import is_back, may_be_back
from tests.slow_cases import others_slow

STOP = "regulatory--stop--g1"
LATER_NS = np.int64(3600e9)


def there_and_back(names: tuple[str, str]) -> tuple[Trajectory, Detections, int]:
    """A street driven both ways within an hour; every sign has the first name on the way there
    and the second on the way back. And how many signs were seen."""
    there = drive_path(turn_rate=0.0)
    back = replace(
        there,
        t_ns=there.t_ns + LATER_NS,
        gps_s=there.gps_s + 3600.0,
        lat_rad=there.lat_rad[::-1],
        lon_rad=there.lon_rad[::-1],
        height_m=there.height_m[::-1],
        vel_ned=-there.vel_ned[::-1],
        rpy=there.rpy + np.array([0.0, 0.0, np.pi]),
    )
    whole = Trajectory(
        **{
            name: np.concatenate([getattr(there, name), getattr(back, name)])
            for name in Trajectory.__dataclass_fields__
        }
    )
    scene = roadside(there)
    middle = slice(1, -1)
    n = len(scene.size_m[middle])
    found, shown = [], []
    for k, (path, name) in enumerate(zip((there, back), names, strict=True)):
        signs = Scene(scene.position[middle], scene.size_m[middle], (name,) * n)
        part, owner = boxes(path, signs, camera(), np.random.default_rng(k))
        found.append(replace(part, frame=part.frame + 100000 * k))
        shown.append(owner)
    both = Detections(
        **{
            name: np.concatenate([getattr(part, name) for part in found])
            for name in ("frame", "t_ns", "class_name", "box", "score", "track")
        }
    )
    assert np.array_equal(np.unique(shown[0]), np.unique(shown[1]))
    return whole, both, len(np.unique(shown[0]))


@pytest.mark.slow
@pytest.mark.parametrize(
    "back", others_slow(["information--unknown-other", "object--traffic-sign--back"])
)
def test_a_sign_seen_from_behind_stays_one(back: str) -> None:
    path, found, n = there_and_back((STOP, back))
    result = locate_signs(path, [found], {"front": camera()})
    assert [sign.class_name for sign in result.signs] == [STOP] * n
    assert min(sign.n_back_views for sign in result.signs) >= 2
    behind = found.class_name == back
    assert set(result.observations.note[behind]) == {"back"}
    assert not result.observations.used[behind].any()
    assert any("show the backs of signs" in text for text in result.warnings)


def test_a_sign_with_two_faces_is_two() -> None:
    path, found, n = there_and_back((STOP, "regulatory--yield--g1"))
    assert len(locate_signs(path, [found], {"front": camera()}).signs) == 2 * n


@pytest.mark.slow
def test_a_plate_that_cannot_be_read_alone_is_a_sign() -> None:
    name = "information--unknown-other"
    path, found, n = there_and_back((name, name))
    assert len(locate_signs(path, [found], {"front": camera()}).signs) == 2 * n


def test_names_of_backs() -> None:
    assert is_back("object--traffic-sign--back")
    assert is_back("Back")
    assert not is_back("warning--give-back-way--g1")
    assert may_be_back("regulatory--unknown-white-square")
    assert not may_be_back("regulatory--unknown-red-circle")
    assert not may_be_back(STOP)
