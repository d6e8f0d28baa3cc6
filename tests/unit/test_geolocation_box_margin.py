"""By how much the margins of boxes differ from sign to sign."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from geolocation_scene import boxes, camera, drive_path, roadside

from automap.geolocation import box_noise, limits
from automap.geolocation.box_noise import margin_scatter, measured_noise
from automap.geolocation.landmark import SizePrior, fit_landmark
from automap.geolocation.views import MeasurementNoise, build_views


def test_margins_that_differ_from_sign_to_sign_are_measured() -> None:
    """Boxes three pixels too tall about one sign, too low about the next."""
    path = drive_path(turn_rate=0.02, duration_s=80.0)
    scene = roadside(path)
    found, owner = boxes(path, scene, camera(), np.random.default_rng(3), noise_px=0.5)
    loose = np.where(np.arange(len(scene.size_m)) % 4 < 2, 1.5, -1.5)[owner]
    wide = replace(found, box=found.box + loose[:, None] * np.array([-1.0, -1.0, 1.0, 1.0]))
    share = {}
    for name, seen in (("tight", found), ("loose", wide)):
        noise = MeasurementNoise(scales=(0.5, 0.5, 0.5))
        views = build_views(path, [seen], {"front": camera()}, noise)
        shown = owner[views.row]
        rows = [np.flatnonzero(shown == k) for k in np.unique(shown)]
        marks = [fit_landmark(views, r, SizePrior()) for r in rows if len(r) >= 6]
        share[name] = margin_scatter(views, marks, SizePrior())
    assert share["tight"] < 0.7
    assert share["loose"] > 1.1


def test_of_many_signs_as_many_tell_of_margins_as_are_enough(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = drive_path(turn_rate=0.0, duration_s=60.0)
    found, owner = boxes(path, roadside(path), camera(), np.random.default_rng(3), noise_px=0.5)
    views = build_views(path, [found], {"front": camera()}, MeasurementNoise())
    shown = owner[views.row]
    rows = [np.flatnonzero(shown == k) for k in np.unique(shown)]
    marks = [fit_landmark(views, r, SizePrior()) for r in rows]
    often = [m for m in marks if m.ok and len(m.rows) >= limits.SCATTER_VIEWS]
    monkeypatch.setattr(limits, "MARGIN_SIGNS", 3)
    asked: list[int] = []
    monkeypatch.setattr(
        box_noise, "margin_scatter", lambda _views, some, _prior: asked.append(len(some)) or 1.0
    )
    measured_noise(views, marks, SizePrior(), MeasurementNoise())
    assert len(often) > 6
    assert 2 <= asked[0] <= 3
