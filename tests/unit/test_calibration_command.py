"""`automap calibrate` as a user meets it: formats, exit codes, files."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from calibration_scene import GRAVITY, random_errors, random_poses, recorded, turned_by_hand

from automap.calibration.fold import corrected
from automap.io.drive import load_drive
from automap.io.imu_calibration import read_imu_calibration
from automap.io.imu_csv import imu_format, read_imu_csv
from automap.records import ImuCalibration, RawImu, TriadCalibration
from pipeline.cli import root

NAMES = "t_ns,gx,gy,gz,ax,ay,az"


def write_csv(path: Path, log: RawImu) -> Path:
    rows = np.column_stack([log.gyro, log.accel]).tolist()
    lines = [NAMES] + [
        f"{t}," + ",".join(f"{v:.8g}" for v in row)
        for t, row in zip(log.t_ns.tolist(), rows, strict=True)
    ]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture(scope="module")
def desk() -> RawImu:
    rng = np.random.default_rng(8)
    return recorded(rng, turned_by_hand(rng, random_poses(rng, 14)), random_errors(rng))


def test_a_drive_refers_to_what_was_written(desk: RawImu, tmp_path: Path) -> None:
    path = write_csv(tmp_path / "imu.csv", desk)
    out = tmp_path / "calibration"
    words = ["calibrate", "static", str(path), "--gravity", str(GRAVITY), "-o", str(out)]
    assert root.run_command([*words, "--apply"]) == 0
    (tmp_path / "drive.toml").write_text(
        'schema = "automap.drive/1"\n[imu]\nfile = "imu.csv"\n'
        'calibration = "calibration/imu_calibration.toml"\n'
    )
    drive = load_drive(tmp_path)
    data = read_imu_csv(path, imu_format(drive)).data
    rest = slice(100, 900)
    assert np.linalg.norm(data.accel[rest].mean(axis=0)) == pytest.approx(GRAVITY, abs=2e-3)
    assert np.abs(data.gyro[rest].mean(axis=0)).max() < 2e-4
    applied = np.loadtxt(out / "imu_corrected.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(applied[:, 1:4], data.gyro, atol=1e-7)
    np.testing.assert_allclose(applied[:, 4:7], data.accel, atol=1e-6)
    # the folder is itself a log
    words[2] = str(tmp_path)
    assert root.run_command(words) == 0
    conditions = tomllib.loads((out / "imu_calibration.toml").read_text())["conditions"]
    assert conditions["inputs"].keys() == {"imu.csv"}


def test_dynamic_on_top_of_static(desk: RawImu, tmp_path: Path) -> None:
    path = write_csv(tmp_path / "desk.csv", desk)
    static, dynamic = tmp_path / "s", tmp_path / "d"
    common = ["--gravity", str(GRAVITY), "-o"]
    assert root.run_command(["calibrate", "static", str(path), *common, str(static)]) == 0
    file = static / "imu_calibration.toml"
    words = ["calibrate", "dynamic", str(path), "--calibration", str(file), *common, str(dynamic)]
    assert root.run_command(words) == 0
    before, after = (read_imu_calibration(f / "imu_calibration.toml") for f in (static, dynamic))
    assert np.abs(np.degrees(after.gyro.bias - before.gyro.bias)).max() < 0.02
    assert "Roll and pitch at rest" in (dynamic / "calibration.html").read_text()


def test_allan_writes_settings(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    n = 6000
    values = np.column_stack([rng.normal(0, 0.01, (n, 3)), rng.normal(0, 0.02, (n, 3))])
    path = tmp_path / "rest.txt"
    np.savetxt(path, values)
    words = ["calibrate", "allan", str(path), "--columns", "gx,gy,gz,ax,ay,az", "--rate", "100",
             "-o", str(tmp_path)]  # fmt: skip
    assert root.run_command(words) == 0
    from pipeline.settings.load import load_settings

    settings = load_settings(tmp_path / "noise.toml")
    assert settings.fuse.gyro_noise == pytest.approx(0.001, rel=0.1)
    assert settings.fuse.accel_noise == pytest.approx(0.002, rel=0.1)


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        (["--gravity", "9.8"], 2, "no log is named"),
        (
            ["LOG", "--columns", "ax,ay,az,gx,gy,gz", "--rate", "9", "--gravity", "98"],
            2,
            "the Earth's",
        ),
        (["LOG", "--columns", "ax,ay,az,gx,gy,foo"], 2, "foo is no column"),
        (["LOG", "--columns", "ax,ay,az,gx,gy,gz"], 2, "--rate"),
        (["LOG", "--columns", "ax,ay,az,gx,gy,-"], 2, "no gz"),
        (["LOG", "--columns", "ax,ay,az,gx,gy,gz,-", "--rate", "100"], 3, "6 columns"),
        (["missing.txt", "--gravity", "9.8"], 3, "missing"),
        (["--accel", "LOG", "--gravity", "9.8"], 2, "go together"),
        (["LOG", "--columns", "ax,ay,az,gx,gy,gz", "--rate", "100"], 3, "no rest"),
    ],
)
def test_what_is_wrong_is_said(
    words: list[str], code: int, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(0)
    t = np.arange(2000)[:, None] / 100.0
    motion = np.sin(t * rng.uniform(3, 6, 6)) * [9, 9, 9, 2, 2, 2]
    np.savetxt(tmp_path / "log.txt", motion + rng.normal(0, 0.01, motion.shape))
    given = [str(tmp_path / "log.txt") if word == "LOG" else word for word in words]
    out = tmp_path / "out"
    assert root.run_command(["calibrate", "static", *given, "-o", str(out)]) == code
    assert text in capsys.readouterr().err
    assert not out.exists()


def test_folding_dynamic_errors_keeps_the_form() -> None:
    rng = np.random.default_rng(0)
    T = np.eye(3) + np.triu(rng.normal(0, 0.01, (3, 3)), 1)
    M = np.eye(3) + rng.normal(0, 0.01, (3, 3)) * ~np.eye(3, dtype=bool)
    before = ImuCalibration(
        TriadCalibration(rng.normal(1, 0.1, 3), rng.normal(0, 0.1, 3), T),
        TriadCalibration(rng.normal(1, 0.1, 3), rng.normal(0, 0.1, 3), M),
    )
    e = rng.normal(0, 0.01, 12)
    gyro, accel = rng.normal(0, 1, (5, 3)), rng.normal(0, 9, (5, 3))
    rates, force = before.apply(gyro, accel)
    after = corrected(before, e)
    w, f = after.apply(gyro, accel)
    np.testing.assert_allclose(w, (1 + e[9:]) * rates + e[3:6], atol=1e-12)
    np.testing.assert_allclose(f, (1 + e[6:9]) * force + e[:3], atol=1e-12)
    np.testing.assert_allclose(np.diag(after.accel.matrix), 1.0)
    assert np.abs(np.tril(after.accel.matrix, -1)).max() == 0.0
