"""Tables of strangers: right in one try, or a sentence that says why not; never quietly wrong."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from automap.io.drive import load_drive
from automap.io.recording import Recording, read_recording
from automap.records import Fixes
from automap.timebase import gps_to_unix
from pipeline.cli.root import run_command
from tests.slow_cases import others_slow
from tests.unit.strangers import WRITERS
from tests.unit.strangers.drive import Truth

SAID: dict[str, tuple[int, str]] = {
    "utm": (3, "holds eastings and northings; convert them"),
    "counts": (3, "specific force is 1.647e+04 m/s^2 in the median"),
    "minutes_only": (3, "have lost their seconds or their hours"),
    "minutes_and_seconds": (3, "have lost their seconds or their hours"),
    "linear_acceleration": (3, "specific force is 1.893 m/s^2 in the median"),
    "swapped": (3, "latitude and longitude are swapped"),
    "attitude_only": (0, "angles (roll, pitch, yaw) in place of turn rates"),
    "scaled_integers": (3, 'write what they are, as units = { lat = "1e-7 deg"'),
    "local_times": (0, "its times name no zone and are taken as UTC"),
    "long_format": (0, "each of its rows is of one sensor"),
    "counter_clockwise": (0, "north and east are swapped"),
    "either_month": (0, 'the dates could be "%m/%d/%Y %H:%M:%S" as well'),
    "parted_degrees": (3, "holds the minutes of an angle whose degrees stand in another"),
    "west_in_the_header": (3, "east is told as west"),
    "heights_in_feet": (0, 'heights are taken as m; write units = { height = "ft" } if they are'),
    "scientific_times": (3, "all rows bear the same t_ns"),
    "physics_toolbox": (0, "fixes without velocity"),
}
"""What a table cannot tell, or tells wrongly: the exit code and the sentence."""


# a sixth of them each time: each is a run of its own
TURNS = [writer for start in range(6) for writer in WRITERS[start::6]]


@pytest.mark.parametrize(
    "write", others_slow(TURNS, len(WRITERS[::6])), ids=[writer.__name__ for writer in TURNS]
)
def test_a_strangers_table_is_right_or_refused(
    write: Callable[[Path], Truth], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = write(tmp_path)
    code = run_command(["init", str(tmp_path), "--yes"])
    output = capsys.readouterr()
    said = " ".join((output.err + output.out).split())
    if write.__name__ in SAID:
        assert code == SAID[write.__name__][0], said
        assert SAID[write.__name__][1] in said
        return
    assert code == 0, said
    manifest = next(tmp_path.rglob("drive.toml"))
    drive = load_drive(manifest.parent)
    recording = read_recording(drive)
    assert recording.failures == ()
    _compare_readings(recording, told, dated=drive.imu.time != "boot_ns", gps=drive.imu.time)
    assert recording.fixes is not None
    _compare_fixes(recording.fixes, told)


def _compare_readings(recording: Recording, told: Truth, dated: bool, gps: str) -> None:
    """As far as they were written with digits; nine of ten rows where some hold holes."""
    imu = recording.imu
    assert imu is not None
    assert len(imu) > 0.9 * len(told.t)
    t = np.asarray(imu.t_ns * 1e-9, np.float64)
    if dated:
        t = np.asarray(gps_to_unix(t), np.float64) if gps == "gps_ns" else t
        # whole seconds are told apart by the rate alone
        assert t[0] == pytest.approx(told.t[0], abs=0.01)
    since = t - t[0]
    at = np.clip(np.searchsorted(told.t - told.t[0], since - 0.005), 0, len(told.t) - 1)
    np.testing.assert_allclose(since, (told.t - told.t[0])[at], atol=0.005)
    # a whole mg is 0.01 m/s^2
    for ours, theirs in ((imu.gyro, told.gyro), (imu.accel, told.accel)):
        np.testing.assert_allclose(ours, theirs[at], atol=0.01)


def _compare_fixes(fixes: Fixes, told: Truth) -> None:
    assert len(fixes) == len(told.fix_t)
    t = np.asarray(gps_to_unix(fixes.gps_s), np.float64)
    if t[0] > 1e9:
        np.testing.assert_allclose(t, told.fix_t, atol=0.002)
    else:
        np.testing.assert_allclose(t - t[0], told.fix_t - told.fix_t[0], atol=0.002)
    good = np.isfinite(fixes.lat_rad)
    assert good.mean() > 0.9
    np.testing.assert_allclose(np.degrees(fixes.lat_rad)[good], told.lat[good], atol=1e-6)
    np.testing.assert_allclose(np.degrees(fixes.lon_rad)[good], told.lon[good], atol=1e-6)
    velocity = told.speed[:, None] * np.stack([np.cos(told.course), np.sin(told.course)], axis=1)
    known = np.isfinite(fixes.vel_ned[:, :2]).all(axis=1)
    assert known.mean() > 0.8
    np.testing.assert_allclose(fixes.vel_ned[known, :2], velocity[known], atol=0.01)
    high = np.isfinite(fixes.height_m)
    np.testing.assert_allclose(fixes.height_m[high], told.height[high], atol=0.01)
