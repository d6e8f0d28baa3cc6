"""Where a receiver contradicts itself an IMU shows how far the path may be off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.earth import metres_per_radian
from automap.fusion.doubts.bridged import bridged, outside
from automap.fusion.doubts.path import fix_misses
from automap.fusion.doubts.position_jump import Places, beside_readings, places_of
from automap.fusion.doubts.reason import Reason
from automap.fusion.doubts.receiver import beside_imu
from automap.fusion.nodes import model_fixes
from automap.fusion.options import FusionOptions
from automap.fusion.widening import widen
from automap.records import Fixes, Trajectory
from automap.sync.velocity_consistency import Interval
from tests.unit.fusion_receiver import GPS0, receive, shifted
from tests.unit.test_fusion_hole import USUAL, corrected_drive
from tests.unit.test_fusion_velocity_step import free_of, path_of
from tests.unit.test_fusion_verdict import misses_of

START, SECONDS, AWAY_M = 100.0, 8.0, 40.0


def _judged(seed: int, follows: bool, until: float = 240.0) -> tuple[Reason, Trajectory, Fixes]:
    """What is told of positions that lie aside for a while, of a path that passes them by or
    ``follows`` them, of the first ``until`` s of a drive."""
    motion, imu = corrected_drive(seed)
    fixes = receive(motion, USUAL, seed, end=until)
    t = fixes.gps_s - GPS0
    inside = (t > START) & (t < START + SECONDS)
    fixes = shifted(fixes, inside[:, None] * [AWAY_M, 0.0, 0.0])
    path = path_of(motion, imu, (0.01, -0.01, 0.01))
    if follows:
        since = path.gps_s - GPS0
        north = np.interp(
            since, [START - 1.0, START, START + SECONDS, START + SECONDS + 1.0], [0, 1, 1, 0]
        )
        path = replace(path, lat_rad=path.lat_rad + AWAY_M * north / metres_per_radian(0.8, 0.0)[0])
    model = model_fixes(fixes, fixes.gps_s, FusionOptions())
    places = beside_readings(places_of(model), free_of(imu), path, np.zeros(3), 0.0)
    span = (START, START + SECONDS)
    parted = [Interval(*(GPS0 + edge for edge in span), AWAY_M)]
    said = Reason("positions_parted", "by 40 m", (span,), error_m=AWAY_M)
    misses = fix_misses(path, model)
    (found,) = bridged([said], parted, places, misses, float(path.gps_s[0]), 0.0, 1.3)
    assert np.count_nonzero(outside(misses, [span]).t) == np.count_nonzero(~inside & (t > 0.0))
    return found, path, fixes


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_a_path_that_wrong_positions_did_not_lead_is_sure(seed: int) -> None:
    found, path, _ = _judged(seed, follows=False)
    (error,) = found.span_errors_m
    assert 0.0 < error < 6.0
    assert found.error_m == error
    # the path is as unsure there as that, and nowhere else
    sd = np.full((len(path), 3), 1.0)
    wide = widen(replace(path, sd_pos_ned=sd), [found], misses_of(np.zeros((0, 3))), None)
    inside = (path.gps_s - GPS0 >= START) & (path.gps_s - GPS0 <= START + SECONDS)
    assert wide.sd_pos_ned[inside, :2] == pytest.approx(np.hypot(1.0, error / np.sqrt(2.0)))
    assert (wide.sd_pos_ned[~inside] == 1.0).all()


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_a_path_that_followed_them_is_not(seed: int) -> None:
    found, _, _ = _judged(seed, follows=True)
    assert found.state == "doubtful"
    assert found.span_errors_m[0] > 0.8 * AWAY_M


def test_a_drive_of_hardly_any_fixes_shows_nothing() -> None:
    said = Reason("positions_parted", "by 40 m", ((1.0, 2.0),), error_m=AWAY_M)
    one, none = np.array([GPS0 + 1.5]), misses_of(np.zeros((0, 3)))
    seen = Places(
        one, np.zeros((1, 2)), one, np.zeros((1, 3)), np.zeros((1, 2, 3)), 0.0 * one, 0.0 * one
    )
    parted = [Interval(GPS0 + 1.0, GPS0 + 2.0, AWAY_M)]
    assert bridged([said], parted, seen, none, GPS0, 0.0, 1.3) == [said]
    (kept,) = beside_imu(
        [replace(said, code="positions_aside")], parted, parted, none, GPS0 + 1.0, GPS0 + 2.0
    )
    assert kept.spans == said.spans


def test_where_the_drive_shows_too_little_all_stays_as_told() -> None:
    found, _, _ = _judged(3, follows=False, until=START + SECONDS + 1.0)
    assert found.span_errors_m == ()
    assert (found.error_m, found.text) == (AWAY_M, "by 40 m")
