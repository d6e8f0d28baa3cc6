"""Neighbours of one class in a pass that is further off its way than they stand apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from geolocation_scene import ORIGIN, Scene, boxes, camera, drive_path, roadside

from automap.earth import from_local_ned, local_ned
from automap.geolocation.locate import locate_signs
from automap.records import Detections, FloatArray, Trajectory

LAP_S = 40.0
OFF_M = np.array([3.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def two_laps() -> tuple[Trajectory, Scene, Detections]:
    """A circle twice past signs, one with a neighbour of its class 4 m north; the trajectory of
    the second lap 3 m off to the north."""
    turn = 2.0 * np.pi / LAP_S
    path = drive_path(2.0 * LAP_S, turn_rate=turn)
    alone = roadside(drive_path(LAP_S, turn_rate=turn), every_s=4.0)
    scene = Scene(
        np.vstack([alone.position, alone.position[4] + [4.0, 0.0, 0.0]]),
        np.append(alone.size_m, alone.size_m[4]),
        (*alone.class_name, alone.class_name[4]),
    )
    found, _ = boxes(path, scene, camera(), np.random.default_rng(1), noise_px=0.5)
    seconds = (path.t_ns - path.t_ns[0]) * 1e-9
    late = np.clip((seconds - LAP_S) / 5.0 + 0.5, 0.0, 1.0)[:, None] * OFF_M
    place = local_ned(path.lat_rad, path.lon_rad, path.height_m, ORIGIN) + late
    lat, lon, height = from_local_ned(place, ORIGIN)
    sd = np.full((len(path), 3), 2.0)
    off = replace(path, lat_rad=lat, lon_rad=lon, height_m=height, sd_pos_ned=sd)
    return off, scene, found


def worst(trajectory: Trajectory, scene: Scene, found: Detections) -> tuple[int, float]:
    """How many signs come out, and how far the worst of the scene's is from the nearest, m."""
    result = locate_signs(trajectory, [found], {"front": camera()})
    here: FloatArray = np.array(
        [local_ned(s.lat_rad, s.lon_rad, 0.0, ORIGIN) for s in result.signs]
    )
    apart = np.hypot(*np.moveaxis(scene.position[:, None, :2] - here[None, :, :2], 2, 0))
    return len(here), float(apart.min(axis=1).max())


@pytest.mark.slow
def test_signs_that_stand_alone_tell_neighbours_apart(
    two_laps: tuple[Trajectory, Scene, Detections],
) -> None:
    """About half of the 3 m stay, since neither lap is better than the other."""
    number, distance = worst(*two_laps)
    assert number == len(two_laps[1].position)
    assert distance < 2.8
