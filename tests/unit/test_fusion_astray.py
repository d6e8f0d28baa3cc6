"""Where a receiver contradicts itself an IMU shows how far the path may be off, and where it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np
import pytest

from automap.earth import metres_per_radian
from automap.fusion.doubts.astray import _chain, beside_imu
from automap.fusion.doubts.bridged import outside
from automap.fusion.doubts.path import Misses, fix_misses
from automap.fusion.doubts.position_jump import Places, beside_readings, heights_of, places_of
from automap.fusion.doubts.reason import Reason
from automap.fusion.nodes import model_fixes
from automap.fusion.options import FusionOptions
from automap.fusion.widening import widen
from automap.records import FloatArray, Trajectory
from automap.sync.velocity_findings import Interval
from tests.unit.fusion_receiver import GPS0, receive, shifted
from tests.unit.test_fusion_hole import USUAL, corrected_drive
from tests.unit.test_fusion_velocity_step import free_of, path_of
from tests.unit.test_fusion_verdict import misses_of

START, SECONDS, AWAY_M, SD_M = 100.0, 8.0, 40.0, 1.3
Aside = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Judged:
    """Reasons by code after an IMU was asked, the path, and the misses of its fixes."""

    found: dict[str, Reason]
    path: Trajectory
    misses: Misses


def judged(
    seed: int, aside: Aside, follows: Aside, jumps: list[tuple[float, float]], until: float = 240.0
) -> Judged:
    """What is told of positions ``aside`` (m north and up at a time, s), of a path that is off
    north by what it ``follows`` them, of the first ``until`` s of a drive; ``jumps`` s of it."""
    motion, imu = corrected_drive(seed)
    fixes = receive(motion, USUAL, seed, end=until)
    fixes = shifted(fixes, aside(fixes.gps_s - GPS0)[:, None] * [1.0, 0.0, -0.5])
    path = path_of(motion, imu, (0.01, -0.01, 0.01))
    north = follows(path.gps_s - GPS0) / metres_per_radian(0.8, 0.0)[0]
    path = replace(path, lat_rad=path.lat_rad + north)
    model = model_fixes(fixes, fixes.gps_s, FusionOptions())
    beside = [
        beside_readings(places, free_of(imu), path, np.zeros(3), 0.0)
        for places in (places_of(model), heights_of(model))
    ]
    parted = [Interval(GPS0 + a, GPS0 + b, AWAY_M) for a, b in jumps]
    said = [
        Reason(code, code, tuple(jumps), error_m=AWAY_M)
        for code in ("positions_parted", "positions_aside")
    ]
    misses = fix_misses(path, model)
    ends = float(path.gps_s[0]), float(path.gps_s[-1])
    told = beside_imu(said, parted, beside[0], beside[1], misses, ends, 0.0, SD_M)
    return Judged({reason.code: reason for reason in told}, path, misses)


def never(t: FloatArray) -> FloatArray:
    return 0.0 * t


def between(first: float, last: float) -> Aside:
    return lambda t: np.where((t > first) & (t < last), AWAY_M, 0.0)


def smoothed(first: float, last: float) -> Aside:
    """As a path goes there and back, in a second."""
    return lambda t: np.interp(t, [first - 1.0, first, last, last + 1.0], [0, AWAY_M, AWAY_M, 0])


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_a_path_that_wrong_positions_did_not_lead_is_sure(seed: int) -> None:
    end = START + SECONDS
    told = judged(seed, between(START, end), never, [(START, end)])
    found, path = told.found["positions_parted"], told.path
    (error,) = found.span_errors_m
    assert 0.0 < error < 6.0
    assert found.error_m == error
    # heights are 20 m off there, and the readings tell where the vehicle was
    assert 0.0 < found.span_heights_m[0] < 6.0
    # the path is as unsure there as that, and nowhere else
    sd = np.full((len(path), 3), 1.0)
    wide = widen(replace(path, sd_pos_ned=sd), [found], misses_of(np.zeros((0, 3))), None)
    (first, last) = found.spans[0]
    since = path.gps_s - path.gps_s[0]
    inside = (since >= first) & (since <= last)
    assert wide.sd_pos_ned[inside, :2] == pytest.approx(np.hypot(1.0, error / np.sqrt(2.0)))
    assert (wide.sd_pos_ned[~inside] == 1.0).all()
    swerving = 0.5 * np.pi * error / (last - first + 6.0)
    moved = np.hypot(path.sd_vel_ned[inside, :2], swerving)
    assert wide.sd_vel_ned[inside, :2] == pytest.approx(moved)
    assert (wide.sd_vel_ned[:, 2] == path.sd_vel_ned[:, 2]).all()
    # what lies there is no witness against the path
    rest = outside(told.misses, found.spans)
    assert np.hypot(*rest.miss[:, :2].T).max() < 0.5 * AWAY_M
    assert len(rest) > len(told.misses) - 1.5 * SECONDS / np.median(np.diff(told.misses.t))


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_a_path_that_followed_them_is_not(seed: int) -> None:
    end = START + SECONDS
    told = judged(seed, between(START, end), smoothed(START, end), [(START, end)])
    found = told.found["positions_parted"]
    assert found.state == "doubtful"
    assert max(found.span_errors_m) > 0.8 * AWAY_M


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_a_place_that_the_path_passes_by_leaves_it_sure_elsewhere(seed: int) -> None:
    """Jumps there and back, and half a minute between in which positions go with velocities."""
    end = START + 30.0
    edges = [(at - 0.5, at + 0.5) for at in (START, end)]
    told = judged(seed, between(START, end), never, edges)
    assert len(told.found["positions_parted"].spans) == 1
    kept = told.found["positions_aside"]
    assert len(kept.spans) == 2
    # over half a minute readings of a tilt nobody knows tell it to some 10 m
    assert max(kept.span_errors_m) < 0.25 * AWAY_M
    # one that went with them is off there, or elsewhere; the place lasted for less than the rest
    told = judged(seed, between(START, end), smoothed(START, end), edges)
    before, there, behind = told.found["positions_aside"].span_errors_m
    assert there > 0.8 * AWAY_M
    assert max(before, behind) < there


@pytest.mark.parametrize("at", [60.0, 120.0])
def test_either_side_of_a_jump_that_the_path_follows_may_be_right(at: float) -> None:
    told = judged(4, between(at, 1e9), smoothed(at, 1e9), [(at - 0.5, at + 0.5)])
    before, behind = told.found["positions_aside"].span_errors_m
    assert told.found["positions_aside"].state == "doubtful"
    # no fix lies within the jump, and the path crosses it
    assert told.found["positions_parted"].state == "doubtful"
    assert told.found["positions_parted"].error_m > 0.3 * AWAY_M
    # a jump of 40 m, on the side that lasted for less with more than even odds
    assert max(before, behind) >= AWAY_M / np.sqrt(2.0) - 1.0
    assert min(before, behind) > 0.3 * AWAY_M
    assert (before > behind) == (at < 100.0) or before == pytest.approx(behind, rel=0.1)


def test_a_drive_of_hardly_any_fixes_shows_nothing() -> None:
    said = Reason("positions_parted", "by 40 m", ((1.0, 2.0),), error_m=AWAY_M)
    one, none = np.array([GPS0 + 1.5]), misses_of(np.zeros((0, 3)))
    seen = Places(
        one, np.zeros((1, 2)), one, np.zeros((1, 3)), np.zeros((1, 2, 3)), 0.0 * one, 0.0 * one
    )
    parted = [Interval(GPS0 + 1.0, GPS0 + 2.0, AWAY_M)]
    assert beside_imu([said], parted, seen, seen, none, (GPS0, GPS0 + 9.0), 0.0, SD_M) == [said]


def test_where_the_drive_shows_too_little_all_stays_as_told() -> None:
    end = START + SECONDS
    told = judged(3, between(START, end), never, [(START, end)], until=end + 1.0)
    found = told.found["positions_parted"]
    assert found.span_errors_m == ()
    assert (found.error_m, found.text) == (AWAY_M, "positions_parted")


def test_a_path_off_the_positions_for_most_of_a_drive_proves_nothing() -> None:
    told = judged(3, between(20.0, 200.0), never, [(19.5, 20.5), (199.5, 200.5)])
    assert min(told.found["positions_aside"].span_errors_m) > 0.5 * AWAY_M


def test_a_chain_of_stretches_is_as_probable_as_all_its_cases_together() -> None:
    rng = np.random.default_rng(5)
    odds, size = rng.normal(-1.0, 1.0, 5), 400.0
    shifts = [(2.0, 1.0), (22.0, 3.0), (0.0, np.inf), (15.0, 10.0)]
    total, wrong = 0.0, np.zeros(5)
    for case in product((0, 1), repeat=5):
        likely = np.exp(odds @ case)
        for (metres, sd), pair in zip(shifts, pairwise(case), strict=True):
            variance = sd**2 + size * sum(pair)
            if np.isfinite(sd):
                likely *= np.exp(-(metres**2) / (2.0 * variance)) / variance
        total += likely
        wrong += likely * np.array(case)
    assert _chain(odds, shifts, size) == pytest.approx(wrong / total, rel=1e-9)
    # nothing seen: as beforehand
    assert _chain(odds[:1], [], size) == pytest.approx(1.0 / (1.0 + np.exp(-odds[:1])))
