"""Wheel speed, as `check` compares it with the receiver's."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from input_drive import BOOT_NS, RATE_HZ, motion, write_drive

from pipeline.check.command import check_drive


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    return write_drive(tmp_path / "formula")


def _with_wheels(drive: Path, factor: float = 1.0, late_s: float = 0.0, stuck: bool = False) -> str:
    """What is said of wheel speed once a second."""
    move = motion()
    rows = np.arange(0, len(move.t), RATE_HZ)
    speed = factor * move.speed[rows]
    if stuck:
        speed[20:50] = speed[20]
    t_ns = BOOT_NS + np.rint((move.t[rows] + late_s) * 1e9).astype(np.int64)
    lines = [f"{t},{v:.4f}\n" for t, v in zip(t_ns, speed, strict=True)]
    (drive / "odometer.csv").write_text("t_ns,speed_m_s\n" + "".join(lines))
    report = check_drive(drive)
    assert report.usable
    found = [f for f in report.findings if f.file == "odometer.csv"]
    return "\n".join(f"{f.severity}: {f.text} -> {f.advice}" for f in found)


def test_wheel_speed_is_compared_with_the_receivers(drive: Path) -> None:
    said = _with_wheels(drive, 1.03, 0.5)
    assert "ok: 90 wheel speeds over 89.0 s, 1 Hz, up to 16.5 m/s" in said
    late = re.search(r"(\d+) ms late .*, ([\d.]+) times as much", said)
    assert late is not None
    # arrival lies some hundredths of a second behind the epoch, and is taken for a tenth
    assert int(late[1]) == pytest.approx(500, abs=80)
    assert float(late[2]) == pytest.approx(1.03, abs=0.003)


@pytest.mark.parametrize(
    ("factor", "late_s", "stuck", "words"),
    [
        (3.6, 0.0, False, "as in km/h; it is not used -> write speed_m_s in metres per second"),
        (2.2369, 0.0, False, "as in miles per hour; it is not used"),
        (1.0, 7.0, False, "7.0 s later than the receiver's; it is not used -> stamp t_ns"),
        (1.0, 4e4, False, "s after it begins; it is not used -> is t_ns in"),
        (1.0, 0.0, True, "30 of 90 wheel speeds are stuck while the vehicle drives -> they are"),
    ],
)
def test_wheel_speed_that_cannot_be_is_named(
    drive: Path, factor: float, late_s: float, stuck: bool, words: str
) -> None:
    assert words in _with_wheels(drive, factor, late_s, stuck)
