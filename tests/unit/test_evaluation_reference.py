"""A reference whose velocities are not those of its positions is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from geolocation_scene import drive_path

from automap.evaluation.reference import contradiction, velocity_apart
from automap.evaluation.trajectory_errors import trajectory_errors
from automap.records import NO_TIME, Trajectory

STATED = 0.02


def _driven(speed: float = 8.0, turn_rate: float = 0.02) -> Trajectory:
    path = drive_path(duration_s=150.0, speed=speed, turn_rate=turn_rate)
    return replace(path, sd_vel_ned=np.full((len(path), 3), STATED))


def _told(truth: Trajectory, path: Trajectory) -> str | None:
    return contradiction(truth, trajectory_errors(path, truth))


def test_velocities_in_other_metres_than_the_positions_are_told() -> None:
    """East by the cosine of another latitude, as in a plane that touches the Earth elsewhere."""
    path = _driven(turn_rate=0.0)
    ahead = path.vel_ned / np.linalg.norm(path.vel_ned, axis=1)[:, None]
    wrong = replace(path, vel_ned=path.vel_ned + 0.05 * ahead)
    off = velocity_apart(wrong)
    assert np.nanmax(np.abs(off - 0.05 * ahead)) < 0.005
    told = _told(wrong, path)
    assert told is not None
    assert "differ over a minute" in told
    assert _told(replace(wrong, t_ns=np.full(len(path), NO_TIME)), path) == told


@pytest.mark.parametrize("turn_rate", [0.0, 0.02, -0.2])
def test_sound_references_are_not_told(turn_rate: float) -> None:
    path = _driven(turn_rate=turn_rate)
    assert _told(path, path) is None
    # noise of a velocity is gone over a minute
    noise = np.random.default_rng(5).normal(0.0, 0.1, path.vel_ned.shape)
    assert _told(replace(path, vel_ned=path.vel_ned + noise), path) is None


def test_a_reference_without_velocities_says_nothing() -> None:
    path = _driven()
    for none in (replace(path, vel_ned=np.full_like(path.vel_ned, np.nan)), _rows(path, 40)):
        assert np.isnan(velocity_apart(none)).all()
        assert _told(none, path) is None
    gaps = _rows(path, None, 150)
    assert np.isnan(velocity_apart(gaps)).all()


@pytest.mark.parametrize("wrong", ["radians", "from east", "backwards"])
def test_headings_that_no_vehicle_has_are_told(wrong: str) -> None:
    path = _driven(turn_rate=0.05)
    yaw = path.rpy[:, 2]
    other = {"radians": np.radians(yaw), "from east": np.pi / 2 - yaw, "backwards": yaw + np.pi}
    rpy = np.column_stack([path.rpy[:, :2], other[wrong]])
    told = _told(replace(path, rpy=rpy), path)
    assert told is not None
    assert "off its nose" in told
    assert _told(replace(path, rpy=np.full_like(rpy, np.nan)), path) is None


def _rows(path: Trajectory, stop: int | None, step: int = 1) -> Trajectory:
    names = Trajectory.__dataclass_fields__
    return Trajectory(**{name: getattr(path, name)[:stop:step] for name in names})
