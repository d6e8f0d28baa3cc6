"""Stamps of frames that err from frame to frame, told from boxes that scatter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from geolocation_scene import boxes, camera, drive_path, roadside

from automap.geolocation.landmark import SizePrior
from automap.geolocation.stamp_scatter import (
    Residuals,
    deviance,
    stamp_scatter,
    told,
    tracked_or_linked,
)
from automap.geolocation.views import MeasurementNoise, Views, build_views
from automap.records import IntArray

FRAME_NS = 100_000_000


def scene(jitter_s: float, noise_px: float, seed: int) -> tuple[Views, list[IntArray]]:
    """A drive past signs, frames stamped ``jitter_s`` off, and the boxes of each sign."""
    rng = np.random.default_rng(seed)
    path = drive_path(turn_rate=0.02, duration_s=40.0)
    found, owner = boxes(path, roadside(path), camera(), rng, noise_px=noise_px)
    _, frame = np.unique(found.t_ns, return_inverse=True)
    off = np.rint(jitter_s * 1e9 * rng.standard_normal(frame.max() + 1)).astype(np.int64)
    late = replace(found, t_ns=found.t_ns + off[frame])

    views = build_views(path, [late], {"front": camera()}, MeasurementNoise())
    shown = owner[views.row]
    groups = [np.flatnonzero(shown == k) for k in np.unique(shown)]
    return views, [rows for rows in groups if len(rows) >= 6]


@pytest.mark.parametrize(("jitter_s", "noise_px"), [(0.05, 0.5), (0.05, 3.0), (0.25, 3.0)])
def test_the_stamps_error_is_found_whatever_the_boxes_scatter_by(
    jitter_s: float, noise_px: float
) -> None:
    views, groups = scene(jitter_s, noise_px, seed=8)
    assert stamp_scatter(views, groups, SizePrior()) == pytest.approx(jitter_s, rel=0.3)


@pytest.mark.parametrize("noise_px", [0.5, 3.0])
def test_right_stamps_are_not_blamed_for_boxes_that_scatter(noise_px: float) -> None:
    assert stamp_scatter(*scene(0.0, noise_px, seed=9), SizePrior()) == 0.0


def test_of_a_car_that_waits_one_box_is_asked_for_stamps() -> None:
    views, groups = scene(0.0, 1.0, seed=9)
    track = np.full(len(views), -1)
    for number, own in enumerate(groups):
        track[own] = number
    # the fourth view of each sign again and again, from where it was
    again = np.repeat([own[3] for own in groups], 200)
    rows = np.concatenate([np.flatnonzero(track >= 0), again])
    columns = {
        name: value[rows]
        for name, value in vars(views).items()
        if isinstance(value, np.ndarray) and len(value) == len(views)
    }
    columns["t_ns"][-len(again) :] += np.tile(np.arange(200), len(groups))
    held = replace(views, **columns | {"track": track[rows]})
    told_of = tracked_or_linked(held, [])
    assert [len(own) for own in told_of] == [len(own) for own in groups]
    assert stamp_scatter(held, told_of, SizePrior()) == 0.0


def test_without_boxes_nothing_is_told() -> None:
    views, _ = scene(0.0, 1.0, seed=9)
    assert stamp_scatter(views, [], SizePrior()) == 0.0


def test_the_likelihood_is_restricted_to_what_the_fit_leaves() -> None:
    """Half of what the stamps move is taken by the fits: the plain likelihood of what is left would
    see half of it."""
    rng = np.random.default_rng(1)

    def sign(n: int = 4, unknowns: int = 6) -> Residuals:
        by_stamp = rng.standard_normal((n, 3))
        by_fit = rng.standard_normal((n, 3, unknowns))
        value = 0.05 * rng.standard_normal((n, 3)) + by_stamp * rng.standard_normal((n, 1))
        x = np.linalg.lstsq(by_fit.reshape(-1, unknowns), value.ravel(), rcond=None)[0]
        return Residuals(value - by_fit @ x, by_stamp, by_fit, np.full(unknowns, 1e-9))

    signs = [sign() for _ in range(120)]
    tried = np.array([0.6, 0.7, 0.85, 1.0, 1.2, 1.4])
    own = np.full(3, 0.05**2)
    best = tried[np.argmin([deviance(signs, own, sd) for sd in tried])]
    assert 0.8 < best < 1.3


def test_only_more_than_an_instant_within_the_frame_is_told() -> None:
    stamps = [np.arange(50) * FRAME_NS, np.arange(90) * FRAME_NS // 3]
    assert told(0.02, stamps) == []
    assert "80 ms" in told(0.08, stamps)[0]
    assert told(0.08, []) == []
