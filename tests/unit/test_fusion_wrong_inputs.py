"""Inputs that a good-looking path would hide are told, and right ones beside them are not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from tempfile import TemporaryFile

import numpy as np
import pytest
from scipy.signal import lfilter

from automap.earth import metres_per_radian
from automap.fusion.aside import put_aside
from automap.fusion.doubts.estimates import (
    impossible_ages,
    unexpected_delay,
)
from automap.fusion.doubts.outcome import unsure_path
from automap.fusion.doubts.path import Misses
from automap.fusion.doubts.receiver import overstated, receiver_doubts, usable_fixes
from automap.fusion.engine import fuse_imu_gnss
from automap.fusion.judged import judged
from automap.fusion.options import FusionOptions
from automap.fusion.result import FusionResult, Prior
from automap.fusion.verdict import weigh
from automap.fusion.weighed import Weighed
from automap.gates import OUTSIDE_95, gate
from automap.io.drive import load_drive
from automap.io.recording import read_recording
from automap.records import ClockModel, DriveClocks, Fixes, ImuData
from automap.sync.velocity_consistency import velocity_consistency
from automap.sync.velocity_findings import VelocityConsistency
from pipeline.check.same_drive import usable_receiver
from pipeline.run.fusion_inputs import _delay_prior
from tests.unit.foreign_tables import SAMPLE
from tests.unit.fusion_drive import CLOCK, Sensor, errors, record
from tests.unit.fusion_fixes import town_fixes
from tests.unit.fusion_motion import city_drive
from tests.unit.fusion_receiver import GPS0, Receiver, receive
from tests.unit.test_fusion_doubted_sigmas import with_late_positions

BY_MOTION = replace(CLOCK, method="correlation", sd_offset_s=0.02)
LEVER = (0.3, 0.2, -1.1)


@pytest.mark.parametrize("off_deg", [-11.0, 6.0, 2.0])
def test_courses_against_another_north_are_turned_back_and_told(off_deg: float) -> None:
    fixes = town_fixes()
    assert not velocity_consistency(fixes).course_off
    course = np.exp(1j * np.radians(off_deg)) * (fixes.vel_ned[:, 0] + 1j * fixes.vel_ned[:, 1])
    off = replace(fixes, vel_ned=np.column_stack([course.real, course.imag, fixes.vel_ned[:, 2]]))
    found = velocity_consistency(off)
    assert [r.code for r in receiver_doubts(found, 0.0)] == ["course_off"]
    back = usable_fixes(off, found).vel_ned
    assert np.abs(back - fixes.vel_ned).max() < np.radians(1.0) * np.abs(fixes.vel_ned).max()
    assert np.array_equal(usable_fixes(fixes, velocity_consistency(fixes)).vel_ned, fixes.vel_ned)


@pytest.mark.parametrize("factor", [1.0, 4.0, 100.0])
def test_accuracies_far_larger_than_positions_scatter_are_told(factor: float) -> None:
    rng = np.random.default_rng(31)
    n = 300
    stated = np.full((n, 3), (2.0 * factor) ** 2)
    miss = 0.7 * rng.standard_normal((n, 3))
    said = overstated(Misses(np.arange(n, dtype=float), miss, stated / 16.0, stated))
    assert [reason.code for reason in said] == ["accuracy_overstated"] * (factor == 100.0)
    if said:
        assert said[0].state == "good"
        assert "200 m an axis" in said[0].text
    unsure = unsure_path(150.0, bool(said))[0]
    assert unsure.state == "unusable"
    assert ("check the unit of its accuracy" in unsure.text) == bool(said)
    assert ("record again" in unsure.text) != bool(said)


# whole drives


def fused(
    receiver: Receiver,
    clock: ClockModel,
    lever: tuple[float, float, float] = LEVER,
    logged: Callable[[Fixes], Fixes] = lambda fixes: fixes,
    read: Callable[[ImuData], ImuData] = lambda imu: imu,
    found: VelocityConsistency | None = None,
) -> tuple[FusionResult, Weighed]:
    """A drive of three minutes, and what is said of its path."""
    motion = city_drive(180.0, 4)
    imu, fixes = read(record(motion, Sensor(), 4)), logged(receive(motion, receiver, 5))
    delay, is_clock = _delay_prior(DriveClocks(clock, "boot_ns"), 0.05)
    arm, options = np.array(lever), FusionOptions()
    result = fuse_imu_gnss(imu, fixes, clock, options, delay, arm, delay_is_clock=is_clock)
    seen = velocity_consistency(fixes) if found is None else found
    with TemporaryFile() as file:
        aside = put_aside(result.path_run(), result.t_ns, file)
        drive = judged(result, aside, fixes, clock, options, delay, is_clock, seen, arm)
        weighed = weigh(drive, lambda: imu, lambda read: read)
        path = weighed.trajectory
        return result, replace(weighed, run=lambda: iter([path]))


@pytest.mark.slow
def test_late_velocities_beside_prompt_positions_are_no_contradiction() -> None:
    """A clock that was found by late velocities is as late: positions then seem to come early."""
    late = replace(BY_MOTION, ref_gps_s=BY_MOTION.ref_gps_s + 0.7)
    result, weighed = fused(Receiver(lever=LEVER, vel_latency=0.7), late)
    assert result.delay.mean == pytest.approx(0.7, abs=0.05)
    assert weighed.verdict.state == "good", weighed.verdict
    # of arrival times it is one: nothing arrives before it was
    found = {"imu_time_offset_s": (result.delay.mean, 0.01)}
    assert [r.code for r in impossible_ages(found, dated_by_arrival=True)] == ["negative_delay"]
    assert impossible_ages(found, dated_by_arrival=False) == []
    prior = Prior(-0.1, 0.1)
    assert unexpected_delay(found, prior.mean, prior.sd, 10.0)[0].code == "delay_unexpected"


@pytest.mark.slow
@pytest.mark.parametrize("clock_late_s", [0.0, 0.6])
def test_stamps_say_how_late_velocities_beside_later_positions_are(clock_late_s: float) -> None:
    """Positions that a filter makes late are dated back by the velocities; by arrival times these
    are known to be late by no more than the stamps are early."""
    clock = replace(CLOCK, ref_gps_s=CLOCK.ref_gps_s - clock_late_s, method="arrival")
    fixes = with_late_positions(receive(city_drive(180.0, 4), Receiver(lever=LEVER), 5), 0.9)
    found = velocity_consistency(fixes)
    back = usable_fixes(fixes, found)
    result, weighed = fused(Receiver(lever=LEVER), clock, logged=lambda _: back, found=found)
    assert result.delay.mean == pytest.approx(-clock_late_s, abs=0.1)
    (reason,) = (r for r in weighed.verdict.reasons if r.code == "positions_late")
    error = errors(weighed.trajectory, city_drive(180.0, 4))[:, :2]
    inside = np.hypot(*(error / weighed.trajectory.sd_pos_ned[:, :2]).T) < np.sqrt(
        gate(OUTSIDE_95, 2)
    )
    assert inside.mean() > 0.95
    if clock_late_s:
        assert reason.state == "doubtful"
        assert reason.late_s > 0.5
    else:
        assert reason.state == "good"
        assert reason.late_s < 0.3


def overshot(fixes: Fixes) -> Fixes:
    """Positions of a filter that goes on as it went, for 1.5 s of what the velocity changed by in
    the last second."""
    keeps = float(np.exp(-np.median(np.diff(fixes.gps_s))))
    was = lfilter([1.0 - keeps], [1.0, -keeps], fixes.vel_ned - fixes.vel_ned[0], axis=0)
    beyond = 1.5 * (was + fixes.vel_ned[0] - fixes.vel_ned)
    north, east = metres_per_radian(fixes.lat_rad, fixes.height_m)
    lat, lon = fixes.lat_rad + beyond[:, 0] / north, fixes.lon_rad + beyond[:, 1] / east
    return replace(fixes, lat_rad=lat, lon_rad=lon)


@pytest.mark.slow
def test_velocities_are_as_unsure_as_their_ways_differ_from_those_of_positions() -> None:
    """Ways through bends that a receiver's filter made too long make the path's speeds too high."""
    _, weighed = fused(Receiver(lever=LEVER), BY_MOTION, logged=overshot)
    path, motion = weighed.trajectory, city_drive(180.0, 4)
    true = motion.at(path.gps_s - GPS0).vel
    off = ((path.vel_ned - true)[:, :2] / path.sd_vel_ned[:, :2]) ** 2
    assert np.mean(off.sum(axis=1) < gate(OUTSIDE_95, 2)) > 0.9


# what a log says throughout


@pytest.mark.parametrize(
    ("factor", "text"),
    [(0.6, "as minutes (48.13 deg as 48 13')"), (1.0 / 0.6, "as hundredths of degrees"), (3.6, "")],
)
def test_minutes_of_arc_that_are_none_are_named_beside_units_of_speed(
    factor: float, text: str
) -> None:
    fixes = town_fixes()
    found = velocity_consistency(replace(fixes, vel_ned=factor * fixes.vel_ned))
    (reason,) = (r for r in found.reasons if r.code == "velocity_unit")
    assert text in reason.text
    assert ("positions are wrong" in reason.text) == bool(text)


def test_a_path_told_twice_is_no_witness_against_the_imu() -> None:
    """Axes judged by a path of swapped coordinates would be accused."""
    drive = load_drive(SAMPLE)
    recording = read_recording(drive)
    fixes = recording.fixes
    assert fixes is not None
    assert usable_receiver(drive, recording)[1] is not None
    crossed = replace(fixes, vel_ned=fixes.vel_ned[:, [1, 0, 2]])
    assert usable_receiver(drive, replace(recording, fixes=crossed))[1] is None


def test_a_receiver_that_holds_still_measures_nothing_meanwhile() -> None:
    fixes = receive(city_drive(120.0, 9), Receiver(rate=1.0), 9)
    speed = np.hypot(*fixes.vel_ned[:, :2].T)
    slow = speed < 1.5
    last_row = np.maximum.accumulate(np.where(slow, 0, np.arange(len(fixes))))
    held = replace(
        fixes,
        lat_rad=fixes.lat_rad[last_row],
        lon_rad=fixes.lon_rad[last_row],
        vel_ned=np.where(slow[:, None], 0.0, fixes.vel_ned),
    )
    usable = usable_fixes(held, velocity_consistency(held))
    assert np.count_nonzero(slow) > 5
    repeats = np.arange(len(fixes)) > last_row
    assert (np.isnan(usable.lat_rad) == repeats).all()
    assert np.isfinite(usable_fixes(fixes, velocity_consistency(fixes)).lat_rad).all()
    # a drive that stands has no others
    one = np.zeros(len(fixes), np.int64)
    stands = replace(
        held, lat_rad=held.lat_rad[one], lon_rad=held.lon_rad[one], vel_ned=0.0 * held.vel_ned
    )
    assert np.isfinite(usable_fixes(stands, velocity_consistency(stands)).lat_rad).all()
