"""Arrival times: reading the file and tying it to epochs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from receiver_messages import GPS, pvt

from automap.errors import InputError
from automap.io.arrival import ArrivalTimes, attach_arrival, read_arrival
from automap.io.receiver import read_receiver_bytes, read_receiver_log
from automap.records import NO_TIME


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "gnss_arrival.csv"
    path.write_text(text)
    return path


def test_columns_are_found_by_name(tmp_path: Path) -> None:
    arrival = read_arrival(
        written(tmp_path, "t_ns, size ,offset\r\n9007199254740993,1,0\r\n9007199254740995,1,7\r\n")
    )
    assert arrival.offset.tolist() == [0, 7]
    assert arrival.t_ns.tolist() == [9007199254740993, 9007199254740995]


def test_a_cut_last_line_is_left_out(tmp_path: Path) -> None:
    for tail in ("200", "200,", "200,90"):
        arrival = read_arrival(written(tmp_path, "offset,t_ns\n0,900\n100,1000\n" + tail))
        assert arrival.offset.tolist() == [0, 100]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("offset,when\n0,1\n", "line 1 names no column t_ns"),
        ("bytes,t_ns\nx,1\n", "line 2, column bytes: 'x'"),
        ("place,t_ns\n0,1\n", "no column offset, nor one that means it"),
        ("offset,t_ns\n", "not one usable row"),
        ("offset,t_ns\n0,1\n\n5,2\n3,3\n", "offset runs backwards in line 5"),
        ("offset,t_ns\n0,5\n5,4\n", "t_ns runs backwards in line 3"),
        ("offset,t_ns\n0,99999999999999999999\n", "line 2, column t_ns"),
    ],
)
def test_bad_files_are_one_clear_sentence(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_arrival(written(tmp_path, text))


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is missing"):
        read_arrival(tmp_path / "missing.csv")
    with pytest.raises(InputError, match="cannot be read"):
        read_receiver_log(tmp_path)
    path = tmp_path / "x.csv"
    path.write_bytes(b"offset,t_ns\n\xff\xfe")
    with pytest.raises(InputError, match="not one usable row"):
        read_arrival(path)


def test_garbled_rows_are_left_out_and_told(tmp_path: Path) -> None:
    rows = [f"{100 * k},{1000 * k}" for k in range(40)]
    rows[7], rows[20], rows[30] = "700,70000000", "20x0,20000", "1,30000"
    arrival = read_arrival(written(tmp_path, "offset,t_ns\n" + "\n".join(rows) + "\n"))
    kept = [k for k in range(40) if k not in (7, 20, 30)]
    assert arrival.t_ns.tolist() == [1000 * k for k in kept]
    assert "line 22, column offset: '20x0'" in arrival.warnings[0]
    assert "where offset does not fit those around" in arrival.warnings[1]
    assert "first in line 32" in arrival.warnings[1]
    assert "first in line 9" in arrival.warnings[2]


def test_an_epoch_arrives_with_the_row_that_holds_its_first_byte() -> None:
    log = read_receiver_bytes(b"junk" + b"".join(pvt(GPS + k) for k in range(4)), "x")
    assert log.fixes.offset.tolist() == [4, 104, 204, 304]
    fixes = attach_arrival(
        log.fixes, ArrivalTimes(np.array([50, 204, 250]), np.array([10, 20, 30]))
    )
    assert fixes.arrival_ns.tolist() == [NO_TIME, 10, 20, 30]
    assert log.fixes.arrival_ns.tolist() == [NO_TIME] * 4
