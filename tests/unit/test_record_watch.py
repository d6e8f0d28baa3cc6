"""What the live view says, and when it warns."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.record.camera import CameraState
from pipeline.record.gnss_watch import GnssState, GnssWatch
from pipeline.record.imu_format import load_format
from pipeline.record.imu_watch import ImuState, ImuWatch
from pipeline.record.messages import MessageStream
from pipeline.record.recorder import Snapshot
from pipeline.record.view import new_events, panel, rows, status_line
from tests.unit.simulated_receiver import nav_pvt

SECOND = 1_000_000_000


def watch_fixes(seconds: list[float], fix: int = 3, satellites: int = 14) -> GnssWatch:
    watch = GnssWatch(wanted_hz=10.0, wall=lambda: 1_773_480_000.5)
    stream = MessageStream()
    for second in seconds:
        t_ns = round(second * SECOND)
        data = nav_pvt(round(second * 1000), fix, satellites)
        watch.count_bytes(t_ns, len(data))
        for message in stream.feed(t_ns, data):
            watch.take(message)
    return watch


def conditions(watch: GnssWatch, at_s: float, last_s: float | None = None) -> set[str]:
    last_ns = round((at_s if last_s is None else last_s) * SECOND)
    return set(watch.conditions(round(at_s * SECOND), 0, last_ns, 9600))


def test_a_good_receiver_gives_no_warning() -> None:
    watch = watch_fixes([0.1 * k for k in range(1, 300)])
    # the dates of the test's clocks are far apart, and 10 Hz fill 9600 baud
    assert conditions(watch, 30.0) <= {"gnss-line", "clock"}
    state = watch.update(30 * SECOND)
    assert (state.fix, state.satellites, state.gaps) == ("3D", 14, 0)
    assert state.rate_hz == pytest.approx(10.0, rel=0.02)
    assert state.lat_deg == pytest.approx(-35.28)


@pytest.mark.parametrize(
    ("times", "fix", "satellites", "at_s", "expected"),
    [
        ([], 3, 14, 5.0, "gnss-silent"),
        ([0.1 * k for k in range(200)], 0, 2, 40.0, "gnss-fix"),
        ([0.1 * k for k in range(200)], 3, 4, 20.0, "gnss-satellites"),
        ([1.0 * k for k in range(30)], 3, 14, 29.5, "gnss-rate"),
    ],
)
def test_what_is_wrong_with_a_receiver(
    times: list[float], fix: int, satellites: int, at_s: float, expected: str
) -> None:
    watch = watch_fixes(times, fix, satellites)
    last_s = 0.0 if not times else at_s
    assert expected in conditions(watch, at_s, last_s)


def test_gaps_of_the_fixes_are_counted() -> None:
    times = [0.1 * k for k in range(1, 100) if not 40 <= k < 60]
    state = watch_fixes(times).update(10 * SECOND)
    assert state.gaps == 1
    assert state.longest_gap_s == pytest.approx(2.1)


def test_bytes_that_make_no_messages() -> None:
    watch = GnssWatch()
    for k in range(40):
        watch.count_bytes(k * SECOND // 10, 100)
    assert watch.unreadable()
    assert "gnss-noise" in conditions(watch, 4.0)


def test_a_receiver_that_forgets_its_settings_is_noticed() -> None:
    watch = watch_fixes([0.1 * k for k in range(1, 100)])
    assert not watch.forgot(10 * SECOND)
    gll = b"$GNGLL,,,,,092000.00,V,N*5F\r\n"
    stream = MessageStream()
    for k in range(100, 160):
        for message in stream.feed(k * SECOND // 10, gll):
            watch.take(message)
    assert watch.forgot(16 * SECOND)


def feed_imu(readings: np.ndarray, rate_hz: float = 100.0) -> tuple[ImuWatch, int]:
    watch = ImuWatch(load_format("automap-csv"))
    stamps = (1 + np.arange(len(readings))) * round(SECOND / rate_hz)
    for at in range(0, len(readings), 10):
        part = slice(at, at + 10)
        watch.take(stamps[part].tolist(), [tuple(row) for row in readings[part].tolist()], 0)
    now = int(stamps[-1])
    watch.update(now, 0.0, 0)
    return watch, now


def still(n: int = 1500) -> np.ndarray:
    rng = np.random.default_rng(3)
    return rng.normal([0, 0, 0, 0, 0, -9.8], 0.02, (n, 6))


def test_a_good_sensor_gives_no_warning() -> None:
    watch, now = feed_imu(still())
    assert watch.conditions(now, 0, now) == {}
    assert watch.state.gravity == pytest.approx(9.8, abs=0.01)
    assert watch.state.rate_hz == pytest.approx(100.0, rel=0.03)


def test_what_is_wrong_with_a_sensor() -> None:
    wrong_unit = still()
    wrong_unit[:, 3:] /= 9.80665
    frozen = np.tile(still(1), (1500, 1))
    dead = still()
    dead[:, 4] = 0.25
    for readings, expected in ((wrong_unit, "gravity"), (frozen, "frozen"), (dead, "dead")):
        watch, now = feed_imu(readings)
        assert f"imu-{expected}" in watch.conditions(now, 0, now)
    watch, now = feed_imu(still())
    assert "imu-silent" in watch.conditions(now + 2 * SECOND, 0, now)
    assert "imu-noise" in watch.conditions(now + 3 * SECOND, 0, now + 3 * SECOND)


def test_damaged_lines_are_a_warning_when_they_are_many() -> None:
    watch, now = feed_imu(still())
    watch.take([now + 10_000_000], [(0, 0, 0, 0, 0, -9.8)], 40)
    assert "imu-bad" in watch.conditions(now + 20_000_000, 0, now)


SNAPSHOT = Snapshot(
    elapsed_s=3725.0,
    gnss=GnssState(fix="3D", good=True, satellites=15, accuracy_m=0.9, lat_deg=-35.28,
                   lon_deg=149.13, speed=12.0, rate_hz=5.0, epochs=18000, clock_offset_s=0.25),
    imu=ImuState(samples=372500, rate_hz=100.0, gaps=2, longest_gap_s=0.5, gravity=9.79,
                 accel=(0.1, 0.2, -9.8), gyro=(0.0, 0.01, 0.0)),
    gnss_port="/dev/ttyACM0@38400", imu_port="/dev/ttyUSB0@115200",
    cameras={"front": CameraState(110000, 29.9, 3, 1280, 720, True)},
    disk_free=70_000_000_000, disk_left_s=36_000.0, bytes_written=12_300_000, bytes_waiting=0,
    troubles=("gnss: only 4 satellites",), events=("   1.0 s  warning: gnss: only 4 satellites",),
)  # fmt: skip


def test_the_panel_shows_it_all(tmp_path: Path) -> None:
    from rich.console import Console

    console = Console(width=110, record=True, file=(tmp_path / "screen").open("w"))
    console.print(panel(SNAPSHOT, Path("drives/monday")))
    text = console.export_text()
    for part in ("1:02:05", "3D, 15 satellites", "gravity 9.79", "2 gaps, the longest 0.5 s",
                 "29.9 frames/s", "70.0 GB left (10 h)", "! gnss: only 4 satellites",
                 "+0.25 s off UTC", "43 km/h"):  # fmt: skip
        assert part in text
    assert any("red" in style for _, _, style in rows(SNAPSHOT)) is False
    assert "gnss 3D, 15 sats, 5.0/s" in status_line(SNAPSHOT)


def test_new_events_are_those_after_the_last_seen() -> None:
    assert new_events((), ("a", "b")) == ("a", "b")
    assert new_events(("a", "b"), ("b", "c", "d")) == ("c", "d")
    assert new_events(("a", "b"), ("a", "b")) == ()
