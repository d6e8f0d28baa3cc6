"""The cases that docs/gap.md walks through, run as they stand there."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

from tests.docs_commands import DOCS, ROOT, Command, commands, files

pytestmark = pytest.mark.slow


def command_with(text: str) -> Command:
    found = [c for c in commands(DOCS / "gap.md") if f" {text} " in f"{c.line} "]
    assert len(found) == 1, text
    return found[0]


def call(command: Command, folder: Path) -> dict[str, Any]:
    """Run a command in a folder; its answer where it writes one."""
    words = [sys.executable, "-c", "from pipeline.cli import main; main()", *command.words[1:]]
    done = subprocess.run(
        words,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    answer = folder / command.words[command.words.index("-o") + 1] / "gap.json"
    return dict(json.loads(answer.read_text(encoding="utf-8"))) if answer.exists() else {}


def run(command: Command, shared_data: Path, folder: Path) -> dict[str, Any]:
    """The command's answer; ``folder`` sees the recordings under the names of the page."""
    for name in ("drives", "imu_calibration"):
        (folder / name).symlink_to(shared_data / name)
    return call(command, folder)


def test_the_desk(shared_data: Path, tmp_path: Path) -> None:
    answer = run(command_with("imu_calibration/xsens-imu-tk/xsens_acc.mat"), shared_data, tmp_path)
    names = [f["effect"] for f in answer["findings"]]
    assert names == ["accel_misalignment", "gyro_g_sensitivity"]
    assert answer["gap_after"] < 0.1 * answer["gap_before"]


def test_the_roof(shared_data: Path, tmp_path: Path) -> None:
    answer = run(command_with("drives/rtk-car-a"), shared_data, tmp_path)
    names = {f["effect"] for f in answer["findings"]}
    # velocities that are differences of positions are half an epoch old
    assert names & {"gnss_velocity_latency", "gnss_velocity_lag"}
    found = {f["effect"]: f["parameters"] for f in answer["findings"]}
    # the quarters of the drive, fitted one by one, have 0.125, 0.147, 0.161 and 0.184 s
    assert found["imu_clock_skew"]["skew"]["value"] == pytest.approx(3e-4, abs=1e-4)
    assert found["imu_time_offset"]["s"]["value"] == pytest.approx(0.125, abs=0.02)
    assert answer["gap_after"] < answer["gap_before"]


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the page's files and its simulated drives."""
    folder = tmp_path_factory.mktemp("simulated")
    for name, content in files(DOCS / "gap.md").items():
        (folder / name).write_text(content, encoding="utf-8")
    for command in commands(DOCS / "gap.md"):
        if command.runnable and command.words[1] == "simulate":
            call(command, folder)
    return folder


@pytest.mark.parametrize(
    ("out", "effect", "values"),
    [
        ("gap-named", "magnet_pull", {"k": 0.1}),
        ("gap-signs", "camera_boresight", {"pitch": -0.008, "yaw": 0.012}),
    ],
)
def test_what_was_hidden_is_named(
    simulated: Path, out: str, effect: str, values: dict[str, float]
) -> None:
    answer = call(command_with(f"-o {out}"), simulated)
    assert [f["effect"] for f in answer["findings"]] == [effect]
    found = answer["findings"][0]["parameters"]
    for parameter, true in values.items():
        assert abs(found[parameter]["value"] - true) < 4.0 * found[parameter]["sd"]


def test_the_formula_of_what_nobody_knows_is_found_and_used(simulated: Path) -> None:
    answer = call(command_with("-o gap-formula"), simulated)
    odd, *others = answer["formulas"]
    assert others == []
    assert answer["unexplained"] == odd
    assert odd["channel"] == "accel_x"
    assert "sin(heading)" in odd["formula"]
    assert odd["gap_after"] < 0.5 * odd["gap_before"]
    model = tomllib.loads((simulated / "gap-formula" / "model.toml").read_text(encoding="utf-8"))
    assert abs(model["fuse"]["fixed"][odd["effect"]]["k"] - 0.1) < 0.02
    call(command_with("-o formula"), simulated)
