"""Faults put into recordings change what they mean to, and are judged as the table says."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from automap.records import NO_TIME, Trajectory
from tests.benchmarks.faults import nmea_log, pos_log, ubx_log
from tests.benchmarks.faults.catalogue import CONTROL, FAULTS, put
from tests.benchmarks.faults.drives import DRIVES, as_toml, matrix_of
from tests.benchmarks.faults.fault import DoesNotApplyError, Reason
from tests.benchmarks.faults.judge import AXES, Errors, Row, errors_of, outcome, verdict_of
from tests.benchmarks.faults.recording import Recording, read_log
from tests.benchmarks.faults.run import run_case, simulate
from tests.benchmarks.faults.table import Results, details, page

SHORT = "kitti-20110930-0033"


@pytest.fixture(scope="module")
def ubx_drive(shared_data: Path) -> Recording:
    return _drive(shared_data, SHORT)


def _drive(data: Path, name: str) -> Recording:
    folder = data / "drives" / name
    if not folder.is_dir():
        pytest.skip(f"the recording {folder} is not there")
    return DRIVES[name].read(folder)


def test_there_are_enough_faults_and_each_can_be_told_apart() -> None:
    assert len(FAULTS) - 1 >= 40
    assert len({fault.what for fault in FAULTS.values()}) == len(FAULTS)
    for fault in FAULTS.values():
        assert fault.name == CONTROL or fault.reasons
        assert not fault.fits(Reason("tyres_worn", "the tyres are worn"), (0.0, 1.0))


def test_rewritten_sentences_carry_their_check_sum() -> None:
    rmc = b"$GPRMC,235959.50,A,3725.415069,N,12205.647326,W,012.5,090.0,311220,,,A*"
    gga = b"$GPGGA,235959.50,3725.415069,N,12205.647326,W,1,,0.38,-32.83,M,0.0,M,0.0,0000*"
    epoch = [s + nmea_log.checksum(s[1:-1].decode()).encode() + b"\r\n" for s in (rmc, gga)]
    was = nmea_log.say(epoch)
    assert nmea_log.write(epoch, was, was) == epoch
    now = was | {"time": was["time"] + 1.0, "lat": -8.25, "lon": 122.0, "speed": 0.0, "dop": 0.5}
    new = nmea_log.write(epoch, was, now)
    assert all(nmea_log.valid(sentence) for sentence in new)
    told = nmea_log.say(new)
    assert all(abs(told[k] - now[k]) < 1e-6 for k in now if k != "climb")
    assert new[0].startswith(b"$GPRMC,000000.50,A,0815.000000,S,12200.000000,E,000.0,090.0,010121")
    assert not nmea_log.valid(new[0].replace(b",E,", b",W,"))


def test_rewritten_rows_of_a_solution_say_what_they_shall() -> None:
    row = b"2025/07/08 19:34:59.999 40.09 -105.14 1601.47 1.0 21.0 0.01 0.01 0.02 0 0 0 0 0 1 2 3"
    row += b" 0.06 0.06 0.06 0 0 0\n"
    was = pos_log.say([row])
    now = was | {"time": was["time"] + 0.2, "height": 1500.0, "course": 180.0, "dop": 20.0}
    told = pos_log.write([row], was, now)
    again = pos_log.say(told) | {"dop": 20.0}
    assert all(abs(again[k] - now[k]) < 1e-4 for k in now if k != "geoid")
    assert told[0].split()[7:10] == [b"0.2000", b"0.2000", b"0.4000"]


@pytest.mark.parametrize("name", ["gsdc-mtv1", "kitti-20111003-0034", SHORT, "rtk-car-a"])
def test_a_log_is_read_without_loss(shared_data: Path, name: str) -> None:
    folder = shared_data / "drives" / name
    if not folder.is_dir():
        pytest.skip(f"the recording {folder} is not there")
    (path,) = folder.glob("gnss.*")
    arrival = folder / "gnss_arrival.csv"
    log = read_log(path, arrival if arrival.exists() else None)
    data, arrivals = log.data()
    assert data == path.read_bytes()
    if arrival.exists():
        lines = arrival.read_text().split()[1:]
        assert lines == [f"{at},{t_ns}" for at, t_ns in arrivals]


def test_a_fault_changes_the_rows_it_means_and_no_others(
    ubx_drive: Recording, tmp_path: Path
) -> None:
    before = ubx_drive.log.data()[0]
    for name, columns in {
        "speed-zero": {"speed"},
        "course-reversed": {"course"},
        "velocity-zero-20": {"speed", "climb"},
        "position-held": {"lat", "lon", "height"},
        "height-steps": {"height"},
        "leap-second": {"time"},
        "dop-high": {"dop"},
    }.items():
        recording = ubx_drive.copy()
        begin, end = put(FAULTS[name], recording)
        path = tmp_path / recording.log_name
        path.write_bytes(recording.log.data()[0])
        log = read_log(path, None)
        assert all(ubx_log.valid(message[0]) for message in log.messages)
        inside = (ubx_drive.log.gps_s >= begin) & (ubx_drive.log.gps_s <= end)
        touched = np.array(
            [
                a != b
                for a, b in zip(
                    ubx_log.split(before), [m for epoch in log.messages for m in epoch], strict=True
                )
            ]
        )
        assert touched.any(), name
        assert not touched[~inside].any(), name
        assert recording.imu.lines == ubx_drive.imu.lines
        # a column of integers keeps a millimetre a second, 1e-5 deg, 1e-7 deg
        for column in {"lat", "lon", "height", "speed", "time", "climb"} - columns:
            old, new = getattr(ubx_drive.log.was, column), getattr(log.was, column)
            assert np.abs(new - old).max() < 2e-3, (name, column)


@pytest.mark.slow
def test_every_fault_changes_something_and_the_same_at_every_call(ubx_drive: Recording) -> None:
    before = _content(ubx_drive)
    for fault in FAULTS.values():
        first, second = ubx_drive.copy(), ubx_drive.copy()
        try:
            put(fault, first)
        except DoesNotApplyError:
            continue
        assert (_content(first) == before) == (fault.name == CONTROL), fault.name
        if fault.name in ("half-missing", "tag-jitter"):
            put(fault, second)
            assert _content(first) == _content(second)
    assert _content(ubx_drive) == before


def _content(recording: Recording) -> tuple[object, ...]:
    return recording.log.data(), recording.imu.lines


def test_readings_change_where_they_should(ubx_drive: Recording) -> None:
    recording = ubx_drive.copy()
    put(FAULTS["accel-burst"], recording)
    other = [k for k, x in enumerate(recording.imu.lines) if x != ubx_drive.imu.lines[k]]
    assert other == list(range(other[0], other[0] + 10))
    assert recording.imu.values("ax")[other[0]] == pytest.approx(1e3)
    assert np.array_equal(recording.imu.values("gz"), ubx_drive.imu.values("gz"))


def _path(north_m: float, sd: float) -> Trajectory:
    n = 50
    known, three = np.zeros(n), np.zeros((n, 3))
    lat = np.full(n, 0.8 + north_m / 6.37e6)
    sds = np.full((n, 3), sd)
    time, none = np.arange(n) + 1.4e9, np.full(n, NO_TIME, np.int64)
    return Trajectory(none, time, lat, known, known, three, three, sds, sds, sds)


def test_errors_count_by_what_is_stated_of_them() -> None:
    whole, part, missing = errors_of(_path(4.0, 2.0), _path(0.0, 1.0), (1.4e9, 1.4e9 + 5.0))
    assert missing == 0.0
    assert whole.ratio == pytest.approx((2.0, 0.0, 0.0), abs=0.01)
    assert whole.held
    assert part.horizontal_m == pytest.approx(4.0, abs=0.02)
    assert not errors_of(_path(4.0, 1.0), _path(0.0, 1.0), (0.0, 1.0))[0].held
    assert not errors_of(_path(0.0, 0.0), _path(1.0, 1.0), (0.0, 1.0))[0].held


HIGH = "the receiver's speeds are 1.3 times too high: look at its log"


@pytest.mark.parametrize(
    ("code", "state", "reason", "told", "result"),
    [
        (3, "none", None, "drive/gnss.nmea: it holds no fix.", "passed"),
        (3, "none", None, "No fix.", "failed"),
        (4, "none", None, "drive/gnss.nmea: no.", "failed"),
        (0, "none", None, "", "failed"),
        (0, "doubtful", Reason("speed_scale", HIGH), "", "passed"),
        (0, "doubtful", Reason("speed_scale", HIGH, ((0.0, 15.0),)), "", "passed"),
        (0, "doubtful", Reason("speed_scale", HIGH, ((50.0, 60.0),)), "", "failed"),
        (0, "doubtful", Reason("gyro", "its bias is large: so are speeds"), "", "failed"),
        (0, "good", Reason("speed_scale", HIGH), "", "failed"),
    ],
)
def test_a_run_passes_by_a_reason_that_fits(
    code: int, state: str, reason: Reason | None, told: str, result: str
) -> None:
    off = Errors(30.0, 1.0, 1.0, (30.0, 1.0, 1.0))
    reasons = (reason,) if reason else ()
    span = (10.0, 20.0)
    row = Row("d", "velocity-zero-10", "given", code, state, reasons, off, off, span, 0.0, told)
    assert outcome(row)[0] == result


def test_a_path_within_its_sigmas_passes_unless_it_cries_wolf() -> None:
    fine = Errors(1.0, 1.0, 1.0, (1.0, 1.0, 1.0))
    row = Row("d", CONTROL, "given", 0, "good", (), fine, fine, (0.0, 1.0), 0.0)
    assert outcome(row)[0] == "passed"
    assert outcome(replace(row, state="doubtful")) == ("failed", "cries wolf")
    assert outcome(replace(row, fault="speed-zero", state="doubtful"))[0] == "passed"
    assert outcome(replace(row, fault="speed-zero", missing=0.5))[0] == "failed"
    far = replace(fine, ratio=(9.0, 9.0, 1.0))
    assert outcome(replace(row, whole=far))[0] == "failed"
    assert outcome(replace(row, whole=far, fault="position-offset"))[0] == "beyond"
    # silent where it was wrong
    assert outcome(replace(row, fault="speed-zero", stretch=far))[0] == "failed"


def test_the_page_sets_given_and_unknown_axes_side_by_side() -> None:
    fine = Errors(1.0, 1.0, 1.2, (1.0, 0.4, 1.0))
    drive = next(iter(DRIVES))
    row = Row(drive, "speed-zero", "given", 0, "good", (), fine, fine, (0.0, 1.0), 0.0)
    refused = replace(row, axes="unknown", code=3, state="none", whole=None, stretch=None)
    refused = replace(refused, told="drive/imu.csv: no.")
    results: Results = {
        (drive, "speed-zero", "given"): ("a1", row),
        (drive, "speed-zero", "unknown"): ("b2", refused),
        (drive, "speed-kmh", "given"): ("b2", "why not"),
    }
    text = page(results)
    assert "| speed-zero | the speed is 0 all the way | 1.0 / refused | 1.20 |" in text
    assert f"`a1` (1 runs of `{drive}`); `b2` (1 runs of `{drive}`)" in text
    assert f"speed-kmh on {drive} (why not)" in text
    assert len(details(results).splitlines()) > 5
    both = {**results, (drive, "speed-zero", "given"): ("a1", replace(refused, axes="given"))}
    assert "| refused | - |" in page(both)


@pytest.mark.slow
def test_a_simulated_drive_runs_with_stated_and_with_unknown_axes(tmp_path: Path) -> None:
    simulate("town", tmp_path)
    for axes in AXES:
        row = run_case(tmp_path, ("town", "hemisphere-east", axes), tmp_path)
        assert isinstance(row, Row)
        assert (row.axes, outcome(row)) == (axes, ("passed", "refused"))


def test_axes_are_written_as_the_manifest_wants_them() -> None:
    text = as_toml(matrix_of((180.0, 0.0, 90.0)))
    assert np.allclose(tomllib.loads(f"a = {text}")["a"], [[0, 1, 0], [1, 0, 0], [0, 0, -1]])


def test_reasons_are_read_from_the_record_of_a_run(tmp_path: Path) -> None:
    assert verdict_of(tmp_path) == ("none", ())
    reason = {"code": "off_the_fixes", "text": "for 9 s: look", "spans_s": [[1.0, 10.0]]}
    told = {"verdict": {"state": "doubtful", "reasons": [reason]}}
    (tmp_path / "run.json").write_text(json.dumps(told))
    read = Reason("off_the_fixes", "for 9 s: look", ((1.0, 10.0),))
    assert verdict_of(tmp_path) == ("doubtful", (read,))
    assert read.claim == "for 9 s"
