"""Real receiver logs: every known message agrees with pyubx2 and pynmeagps, value by value."""

from __future__ import annotations

import datetime as dt
import io
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pyubx2 = pytest.importorskip("pyubx2")

from automap import timebase as tb  # noqa: E402
from automap.io.arrival import attach_arrival, read_arrival  # noqa: E402
from automap.io.nmea import SENTENCES, decode_nmea, unpack_text  # noqa: E402
from automap.io.receiver import read_receiver_log  # noqa: E402
from automap.io.ubx import decode_ubx  # noqa: E402
from automap.io.ubx_layouts import LAYOUTS  # noqa: E402
from automap.records import FixType  # noqa: E402

LOGS = [
    "gnss_logs/gpsd/ublox-8.log",
    "gnss_logs/gpsd/ublox-glo.log",
    "gnss_logs/gpsd/ublox-neo-m8l.log",
    "gnss_logs/gpsd/ublox-neo-m8u.log",
    "gnss_logs/gpsd/ublox-neo-m9n-nmea.log",
    "drives/kitti-20110926-0009/gnss.ubx",
    "drives/kitti-20110926-0014/gnss.ubx",
    "drives/kitti-20110930-0034/gnss.nmea",
    "reference/white-noise-drive/gnss.ubx",
    *(
        pytest.param(log, marks=pytest.mark.slow)
        for log in (
            "gnss_logs/walk-m8-rawx/gnss_1730.ubx",
            "drives/balzer-car/gnss.nmea",
            "drives/gsdc-mtv1/gnss.nmea",
            "drives/gsdc-mtv1-xl/gnss.nmea",
            "drives/iphone-austin/gnss.nmea",
            "drives/kitti-20110926-0032/gnss.ubx",
            "drives/kitti-20110926-0059/gnss.ubx",
            "drives/kitti-20110926-0101/gnss.ubx",
            "drives/kitti-20110926-0104/gnss.ubx",
            "drives/kitti-20110930-0020/gnss.ubx",
            "drives/kitti-20110930-0033/gnss.ubx",
            "drives/kitti-20111003-0034/gnss.nmea",
        )
    ),
]
"""All logs of receivers among the recordings; those that are long with ``-m slow``."""


def parsed(data: bytes) -> dict[str, list[Any]]:
    """All messages as the oracles read them, by identity (NMEA without the talker)."""
    groups: dict[str, list[Any]] = defaultdict(list)
    reader = pyubx2.UBXReader(io.BytesIO(data), protfilter=3, quitonerror=0, parsebitfield=0)
    for _, message in reader:
        if isinstance(message, pyubx2.UBXMessage):
            groups[message.identity].append(message)
        elif message is not None and hasattr(message, "msgID"):
            name = "PUBX00" if message.identity == "PUBX00" else message.msgID
            groups[name].append(message)
    return groups


def test_no_log_of_a_receiver_is_left_out(shared_data: Path) -> None:
    named = {log if isinstance(log, str) else log.values[0] for log in LOGS}
    folders = ("gnss_logs", "drives", "reference")
    there = {
        str(path.relative_to(shared_data))
        for folder in folders
        for path in (shared_data / folder).rglob("*")
        if path.suffix in (".ubx", ".nmea", ".log")
    }
    assert there == named


@pytest.mark.parametrize("log", LOGS)
def test_ubx_tables_equal_pyubx2(shared_data: Path, log: str) -> None:
    data = (shared_data / log).read_bytes()
    oracle = {name: rows for name, rows in parsed(data).items() if name in LAYOUTS}
    tables = decode_ubx(data)
    assert {n: len(t) for n, t in tables.items() if n in LAYOUTS} == {
        n: len(rows) for n, rows in oracle.items()
    }
    for name, rows in oracle.items():
        for field, _, scale in LAYOUTS[name].fields:
            if not hasattr(rows[0], field):
                continue
            got = tables[name][field].tolist()
            for mine, message in zip(got, rows, strict=True):
                theirs = getattr(message, field)
                if isinstance(theirs, bytes):
                    theirs = int.from_bytes(theirs, "little")
                scaled = isinstance(theirs, float) and not isinstance(mine, float)
                assert (mine * scale if scaled else mine) == pytest.approx(theirs, rel=1e-12), field


@pytest.mark.parametrize("log", LOGS)
def test_nmea_tables_equal_pynmeagps(shared_data: Path, log: str) -> None:
    data = (shared_data / log).read_bytes()
    oracle = {name: rows for name, rows in parsed(data).items() if name in SENTENCES}
    tables = decode_nmea(data)
    assert {n: len(t["offset"]) for n, t in tables.items()} == {
        n: len(rows) for n, rows in oracle.items()
    }
    for name, rows in oracle.items():
        for row, message in enumerate(rows):
            assert_sentence_equal(tables[name], row, message)


def assert_sentence_equal(table: dict[str, Any], row: int, message: Any) -> None:
    for column, values in table.items():
        if column == "talker":
            assert values[row] == message.talker
            continue
        if column == "offset":
            continue
        number = column.rpartition("_")
        field = f"{number[0]}_{int(number[2]):02d}" if number[2].isdigit() else column
        theirs = getattr(message, field, "")
        mine = values[row]
        if isinstance(theirs, dt.time):
            seconds = theirs.hour * 3600 + theirs.minute * 60 + theirs.second
            assert mine == pytest.approx(seconds + theirs.microsecond * 1e-6, abs=1e-6)
        elif isinstance(theirs, dt.date):
            assert int(mine) == theirs.day * 10000 + theirs.month * 100 + theirs.year % 100
        elif theirs == "" or theirs is None:
            assert np.isnan(mine) or mine == 0, column
        elif column in ("systemId", "signalID"):
            assert mine == (int(theirs, 16) if isinstance(theirs, str) else theirs)
        elif isinstance(theirs, str) and column in ("ltzh", "ltzn"):
            assert mine == float(theirs)
        elif isinstance(theirs, str):
            assert unpack_text(mine) == theirs
        else:
            assert mine == pytest.approx(theirs, abs=1e-9), column


def test_sensor_readings_equal_pyubx2(shared_data: Path) -> None:
    for log in ("ublox-neo-m8l.log", "ublox-neo-m8u.log"):
        data = (shared_data / "gnss_logs/gpsd" / log).read_bytes()
        oracle = parsed(data)
        tables = decode_ubx(data)
        expected = []
        for message in oracle["ESF-MEAS"]:
            flags = int.from_bytes(message.flags, "little")
            for k in range(1, (flags >> 11) + 1):
                word = int.from_bytes(getattr(message, f"data_{k:02d}"), "little")
                expected.append((message.timeTag, word >> 24 & 63, signed24(word)))
        table = tables["ESF-MEAS"]
        assert list(zip(table["tag"], table["type"], table["value"], strict=True)) == expected
        expected = []
        for message in oracle.get("ESF-RAW", []):
            for k in range(1, 200):
                if not hasattr(message, f"data_{k:02d}"):
                    break
                word = int.from_bytes(getattr(message, f"data_{k:02d}"), "little")
                tag = int.from_bytes(getattr(message, f"sTag_{k:02d}"), "little")
                expected.append((tag, word >> 24, signed24(word)))
        if expected:
            table = tables["ESF-RAW"]
            assert list(zip(table["tag"], table["type"], table["value"], strict=True)) == expected


def signed24(word: int) -> int:
    value = word & 0xFFFFFF
    return value - (1 << 24) if value & 0x800000 else value


@pytest.mark.parametrize("log", LOGS)
def test_every_message_is_counted_by_name(shared_data: Path, log: str) -> None:
    path = shared_data / log
    counts: Counter[str] = Counter()
    reader = pyubx2.UBXReader(io.BytesIO(path.read_bytes()), protfilter=3, quitonerror=0)
    for _, message in reader:
        if isinstance(message, pyubx2.UBXMessage):
            counts["UBX-" + message.identity] += 1
        elif hasattr(message, "identity"):
            counts["NMEA-" + message.identity] += 1
    mine = {n: c for n, c in read_receiver_log(path).messages.items() if "checksum" not in n}
    assert mine == dict(counts)


def test_a_receiver_with_its_own_sensors_is_an_imu(shared_data: Path) -> None:
    for log, rate in (("ublox-neo-m8l.log", 11.1), ("ublox-neo-m8u.log", 100.0)):
        result = read_receiver_log(shared_data / "gnss_logs/gpsd" / log)
        imu = result.imu
        assert imu is not None
        assert np.all(np.diff(imu.tag_s) > 0)
        assert 1.0 / np.median(np.diff(imu.tag_s)) == pytest.approx(rate, rel=0.02)
        # at rest or nearly so: gravity in all, room temperature in the box
        assert np.linalg.norm(imu.accel.mean(axis=0)) == pytest.approx(9.8, abs=0.4)
        assert imu.temp_c is not None
        assert 10.0 < imu.temp_c.mean() < 50.0
        assert imu.gps_s is not None
        assert abs(np.median(imu.gps_s) - np.median(result.fixes.gps_s)) < 5.0


@pytest.mark.slow
def test_the_walk_agrees_with_its_rtklib_solution(shared_data: Path) -> None:
    """A log and the .pos that was made of its own NMEA output: same epochs, same positions."""
    folder = shared_data / "gnss_logs/walk-m8-rawx"
    log = read_receiver_log(folder / "gnss_1730.ubx")
    pos = read_receiver_log(folder / "gnss_1730_sf.pos").fixes
    fixes = log.fixes
    assert log.kind == "mixed"
    assert len(fixes) == len(pos) == 536
    row = np.searchsorted(pos.gps_s, fixes.gps_s - 0.1)
    both = row < len(pos)
    same = np.abs(pos.gps_s[row[both]] - fixes.gps_s[both])
    assert np.median(same) < 1.5e-3
    metres = np.abs(pos.lat_rad[row[both]] - fixes.lat_rad[both]) * 6.4e6
    assert np.median(metres) < 0.01
    assert set(fixes.fix_type) == {FixType.FLOAT, FixType.FIXED}


@pytest.mark.parametrize(
    "drive",
    ["kitti-20110926-0009", "kitti-20110926-0014", "kitti-20110930-0034", "kitti-20111003-0034"],
)
def test_drives_agree_with_their_truth_in_time(shared_data: Path, drive: str) -> None:
    folder = shared_data / "drives" / drive
    log = next(folder.glob("gnss.*"))
    result = read_receiver_log(log)
    fixes = result.fixes
    assert not result.warnings
    assert np.all(fixes.fix_type == FixType.THREE_D)
    assert np.allclose(np.diff(fixes.gps_s), 0.2, atol=1e-6)
    year = 1980.0 + fixes.gps_s[0] / (365.25 * 86400)
    assert 2011.5 < year < 2012.0
    arrival = read_arrival(folder / "gnss_arrival.csv")
    fixes = attach_arrival(fixes, arrival)
    delay = fixes.arrival_ns * 1e-9 - fixes.gps_s
    assert np.isin(fixes.arrival_ns, arrival.t_ns).all()
    # the host clock of the drives drifts by parts in a million; delays vary by tenths at most
    assert np.ptp(delay) < 0.5


def test_the_reference_drive_has_its_documented_clock(shared_data: Path) -> None:
    folder = shared_data / "reference/white-noise-drive"
    fixes = read_receiver_log(folder / "gnss.ubx").fixes
    arrival = read_arrival(folder / "gnss_arrival.csv")
    fixes = attach_arrival(fixes, arrival)
    true_arrival = 1457486418.0 + (fixes.arrival_ns - 4000000000000) * 1e-9
    delay = true_arrival - fixes.gps_s
    assert delay.min() > 0.0
    assert np.median(delay) < 0.3


def test_a_real_car_with_velocity(shared_data: Path) -> None:
    log = read_receiver_log(shared_data / "drives/rtk-car-a/gnss.pos")
    fixes = log.fixes
    assert log.kind == "rtklib"
    assert np.allclose(np.diff(fixes.gps_s), 0.25, atol=1e-6)
    assert tb.gps_to_iso(float(fixes.gps_s[0])) == "2025-07-08T19:34:00.499Z"
    north = np.diff(fixes.lat_rad) * 6_359_000.0 / 0.25
    assert np.sqrt(np.mean((north - fixes.vel_ned[1:, 0]) ** 2)) < 0.1
    down = -np.diff(fixes.height_m) / 0.25
    assert np.sqrt(np.mean((down - fixes.vel_ned[1:, 2]) ** 2)) < 0.1
