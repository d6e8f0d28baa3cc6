"""Deliberate faults are caught and unchanged code passes, whatever the machine rounds."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.regress.command import Request, Session, regress, store
from pipeline.settings.load import load_settings

pytestmark = pytest.mark.slow

DRIVES = ("kitti-20110926-0104", "rtk-car-a")


@pytest.fixture(scope="module")
def baseline(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("regress")
    path = folder / "baseline.json"
    request = Request(
        [shared_data / "drives" / name for name in DRIVES],
        path,
        None,
        load_settings(),
        new_drives_welcome=True,
    )
    store(regress(request), request)
    return path


def copied(shared_data: Path, name: str, folder: Path) -> Path:
    shutil.copytree(shared_data / "drives" / name, folder / name, copy_function=shutil.copyfile)
    (folder / name).chmod(0o755)
    for path in (folder / name).rglob("*"):
        path.chmod(0o755 if path.is_dir() else 0o644)
    return folder / name


def against(baseline: Path, drive: Path, work: Path) -> Session:
    return regress(Request([drive], baseline, work, load_settings()))


def moved(session: Session) -> list[str]:
    """Figures that moved; times are left to machines that have nothing else to do."""
    return [c.name for c in session.results[0].moved if c.group != "timing"]


@pytest.mark.parametrize("name", DRIVES)
@pytest.mark.parametrize("seed", range(5))
def test_rounding_moves_nothing(
    shared_data: Path, baseline: Path, tmp_path: Path, name: str, seed: int
) -> None:
    drive = copied(shared_data, name, tmp_path)
    random = np.random.default_rng(seed)
    # seed 0: the very recording; else every reading off by some 1e-9 of itself
    if seed:
        table = pd.read_csv(drive / "imu.csv")
        for column in table.columns.drop("t_ns"):
            table[column] *= 1.0 + 1e-9 * random.standard_normal(len(table))
        table.to_csv(drive / "imu.csv", index=False, float_format="%.17g")
    session = against(baseline, drive, tmp_path / "work")
    assert session.results[0].error == ""
    assert moved(session) == []
    largest = max(c.sigmas for c in session.results[0].changes if c.sigmas is not None)
    assert largest < 0.02


@pytest.mark.parametrize("name", DRIVES)
def test_a_lever_arm_off_by_half_a_metre_is_caught(
    shared_data: Path, baseline: Path, tmp_path: Path, name: str
) -> None:
    drive = copied(shared_data, name, tmp_path)
    text = (drive / "drive.toml").read_text()
    text = text.replace("\nlever_arm_m = [0.0, 0.0, 0.0]", "", 1)
    text = text.replace("[gnss]\n", "[gnss]\nlever_arm_m = [0.5, 0.0, 0.0]\n")
    (drive / "drive.toml").write_text(text)
    session = against(baseline, drive, tmp_path / "work")
    assert session.exit_code == 5
    assert {"north", "east"} & set(moved(session))


@pytest.mark.parametrize("name", DRIVES)
def test_imu_stamps_off_by_thirty_milliseconds_are_caught(
    shared_data: Path, baseline: Path, tmp_path: Path, name: str
) -> None:
    drive = copied(shared_data, name, tmp_path)
    lines = (drive / "imu.csv").read_text().splitlines()
    at = lines[0].split(",").index("t_ns")
    rows = [line.split(",") for line in lines[1:]]
    for row in rows:
        row[at] = str(int(row[at]) + 30_000_000)
    (drive / "imu.csv").write_text("\n".join([lines[0], *map(",".join, rows)]) + "\n")
    session = against(baseline, drive, tmp_path / "work")
    assert session.exit_code == 5
    assert "imu_delay_s" in moved(session)


def test_a_detector_that_misses_signs_and_places_boxes_worse_is_caught(
    shared_data: Path, baseline: Path, tmp_path: Path
) -> None:
    drive = copied(shared_data, DRIVES[0], tmp_path)
    path = drive / "video" / "front_detections.csv"
    table = pd.read_csv(path)
    random = np.random.default_rng(3)
    table = table[random.random(len(table)) > 0.2].copy()
    for first, second in (("x_min", "x_max"), ("y_min", "y_max")):
        shift = 2.0 * random.standard_normal(len(table))
        table[first] += shift
        table[second] += shift
    table.to_csv(path, index=False)
    session = against(baseline, drive, tmp_path / "work")
    assert session.exit_code == 5
    assert any(c.group == "signs" for c in session.results[0].moved)
