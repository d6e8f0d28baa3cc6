"""The real cases that docs/gap.md walks through, run as they stand there."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.docs_commands import DOCS, ROOT, Command, commands

pytestmark = pytest.mark.slow


def command_with(text: str) -> Command:
    found = [c for c in commands(DOCS / "gap.md") if text in c.line]
    assert len(found) == 1, text
    return found[0]


def run(command: Command, shared_data: Path, folder: Path) -> dict[str, Any]:
    """The command's answer; ``folder`` sees the recordings under the names of the page."""
    for name in ("drives", "imu_calibration"):
        (folder / name).symlink_to(shared_data / name)
    words = [sys.executable, "-c", "from pipeline.cli import main; main()", *command.words[1:]]
    done = subprocess.run(
        words,
        cwd=folder,
        env={"PYTHONPATH": str(ROOT), "PATH": "", "HOME": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    out = folder / command.words[command.words.index("-o") + 1]
    answer: dict[str, Any] = json.loads((out / "gap.json").read_text(encoding="utf-8"))
    return answer


def test_the_desk(shared_data: Path, tmp_path: Path) -> None:
    answer = run(command_with("xsens_acc.mat"), shared_data, tmp_path)
    names = [f["effect"] for f in answer["findings"]]
    assert names == ["accel_misalignment", "gyro_g_sensitivity"]
    assert answer["gap_after"] < 0.1 * answer["gap_before"]


def test_the_roof(shared_data: Path, tmp_path: Path) -> None:
    answer = run(command_with("rtk-car-a"), shared_data, tmp_path)
    names = {f["effect"] for f in answer["findings"]}
    # velocities that are differences of positions are half an epoch old
    assert names & {"gnss_velocity_latency", "gnss_velocity_lag"}
    assert answer["gap_after"] < answer["gap_before"]
