"""Receivers with sensors of their own as whole drives: what comes out, whatever they did."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from automap.io import names
from pipeline.cli.root import run_command


@pytest.mark.parametrize(
    ("log", "epochs", "readings"), [("ublox-neo-m8l", 19, 210), ("ublox-neo-m8u", 3, 290)]
)
def test_a_standing_receiver_gives_its_track(
    shared_data: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    log: str,
    epochs: int,
    readings: int,
) -> None:
    drive, out = tmp_path / "drive", tmp_path / "out"
    drive.mkdir()
    (drive / "drive.toml").write_text('schema = "automap.drive/1"\n')
    shutil.copyfile(shared_data / "gnss_logs" / "gpsd" / f"{log}.log", drive / "gnss.ubx")
    assert run_command(["run", str(drive), "-o", str(out)]) == 0
    text = capsys.readouterr().out
    assert "the receiver's own sensors" in text
    # it stood still, so that nothing tells which way its sensors look
    assert "the vehicle moved for only 0 s" in text
    ingest = json.loads((out / names.INGEST).read_text())
    assert (ingest["imu"]["used"], ingest["imu"]["time"]) == (readings, "gps_ns")
    assert ingest["gnss"]["fixes"] == epochs
    assert json.loads((out / names.SYNC).read_text())["time_base"] == "gps_ns"
    assert f"{epochs} epochs from GPS alone" in text
    assert (out / names.REPORT).is_file()
