"""Signs of another size than their class, which bearings and the heights of boxes place apart."""

from __future__ import annotations

import numpy as np
import pytest
from geolocation_scene import ORIGIN, Scene, boxes, camera, drive_path, roadside

from automap.earth import local_ned
from automap.gates import OUTSIDE_95, gate
from automap.geolocation.landmark import SizePrior
from automap.geolocation.locate import locate_signs
from automap.geolocation.rules import GeolocationRules
from automap.records import FloatArray, Sign

SIZES = SizePrior(0.75, 0.1)


def located(factor: float, last: slice) -> tuple[Sign, FloatArray]:
    """The third sign of a street whose others are of one size, by those of its boxes only, and
    where it stands."""
    path = drive_path()
    alike = roadside(path)
    size = alike.size_m.copy()
    size[2] *= factor
    world = Scene(alike.position, size, ("one-class",) * len(size))
    found, owner = boxes(path, world, camera(), np.random.default_rng(5))
    its = np.flatnonzero(owner == 2)
    kept = np.setdiff1d(np.arange(len(owner)), np.setdiff1d(its, its[last]))
    rules = GeolocationRules(size=SIZES, estimate_camera=False, min_existence=0.0)
    # two boxes of thirty that were due are not asked whether they are a sign
    result = locate_signs(path, [found.at(kept)], {"front": camera()}, rules)
    of_it = np.flatnonzero(owner[kept] == 2)
    (sign,) = (s for s in result.signs if np.isin(s.detection_rows, of_it).all())
    return sign, world.position[2]


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.5, 1.5, 2.0, 3.0])
def test_a_sign_of_an_odd_size_is_in_its_ellipse_by_few_boxes(factor: float) -> None:
    for last in (slice(5, 8), slice(10, 12)):
        if factor < 1.0 and last == slice(10, 12):
            continue  # from afar two boxes of half the size are as of one
        sign, true = located(factor, last)
        here = (np.array([sign.lat_rad]), np.array([sign.lon_rad]), np.array([sign.height_m]))
        error = (true - local_ned(*here, ORIGIN)[0])[[1, 0]]
        assert float(error @ np.linalg.solve(sign.cov_enu[:2, :2], error)) < gate(OUTSIDE_95, 2)


@pytest.mark.slow
def test_the_size_of_a_sign_seen_often_is_told_whatever_its_class() -> None:
    sign, _ = located(3.0, slice(None))
    assert sign.status == "ok"
    assert abs(sign.size_m / (3.0 * 0.75) - 1.0) < 0.1
