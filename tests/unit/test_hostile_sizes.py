"""Inputs that are small and ask for much: a sentence, soon, and in little memory."""

from __future__ import annotations

import resource
import time
import zipfile
from pathlib import Path

import pytest

from automap.errors import InputError
from automap.io.imu_csv import read_imu_csv
from automap.io.limits import MAX_COLUMNS, MAX_ROW_BYTES
from automap.io.sensor_logger import read_sensor_logger

HEAD = "t_ns,gx,gy,gz,ax,ay,az"
ROWS = [f"{10**12 + i * 10**7},0.1,0.{i},0.2,0.1,0.2,9.8" for i in range(60)]


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


@pytest.mark.slow
def test_an_archive_that_unpacks_to_gigabytes(tmp_path: Path) -> None:
    path = tmp_path / "phone.zip"
    rows = "\n".join(["time,seconds_elapsed,z,y,x", "1700000000000000000,0.1,0.1,0.2,9.8", ""])
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name in ("Gyroscope", "TotalAcceleration"):
            archive.writestr(f"{name}.csv", rows)
        # one that is of no use, and 2 GB of nothing
        with archive.open("Barometer.csv", "w", force_zip64=True) as entry:
            for _ in range(128):
                entry.write(bytes(1 << 24))
    assert path.stat().st_size < 10_000_000
    before, started = peak_mb(), time.process_time()
    with pytest.raises(InputError) as told:
        read_sensor_logger(path)
    assert len(str(told.value)) < 1000
    assert peak_mb() - before < 200.0
    assert time.process_time() - started < 5.0


@pytest.mark.parametrize("count", [MAX_COLUMNS + 1, 100_000])
def test_a_header_of_very_many_names(tmp_path: Path, count: int) -> None:
    path = tmp_path / "imu.csv"
    names = ",".join(f"c{k}" for k in range(count))
    path.write_text("\n".join([f"{HEAD},{names}", *ROWS, ""]))
    started = time.process_time()
    with pytest.raises(InputError) as told:
        read_imu_csv(path)
    assert len(str(told.value)) < 1000
    assert time.process_time() - started < 5.0


def test_a_row_of_more_than_a_megabyte(tmp_path: Path) -> None:
    path = tmp_path / "imu.csv"
    path.write_text("\n".join([HEAD, *ROWS, "9" * (MAX_ROW_BYTES + 1), ""]))
    # the row is counted and told of, the others are read
    found = read_imu_csv(path)
    assert 0 < sum(map(len, found.warnings)) < 1000


def test_lines_that_end_as_of_old_are_read_without_a_long_warning(tmp_path: Path) -> None:
    path = tmp_path / "imu.csv"
    path.write_bytes("\r".join([HEAD, *ROWS, ""]).encode())
    found = read_imu_csv(path)
    assert sum(map(len, found.warnings)) < 1000
