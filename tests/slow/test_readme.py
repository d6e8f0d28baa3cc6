"""Every command in the README works, in the order in which it stands there."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from automap.io.drive import load_drive
from pipeline.cli.root import _COMMANDS

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
SAMPLE = ROOT / "data" / "sample-drive"


def fences(language: str) -> list[str]:
    """The code blocks of the language."""
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.MULTILINE | re.DOTALL)


def commands() -> list[str]:
    """The command lines of the shell blocks."""
    return [line for block in fences("sh") for line in block.splitlines() if line.strip()]


@pytest.mark.slow
def test_every_automap_command_runs(tmp_path: Path) -> None:
    if not (SAMPLE / "drive.toml").is_file():
        pytest.skip("data/sample-drive is not there")
    shutil.copytree(
        SAMPLE, tmp_path / "data" / "sample-drive", ignore=shutil.ignore_patterns("_automap")
    )
    # `automap` means this checkout, whether or not it is installed
    launcher = tmp_path / "bin" / "automap"
    launcher.parent.mkdir()
    launcher.write_text(
        f"#!/bin/sh\nexec {sys.executable} -c 'from pipeline.cli import main; main()' \"$@\"\n"
    )
    launcher.chmod(0o755)
    environment = {
        **os.environ,
        "PATH": f"{launcher.parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
    }
    lines = [line for line in commands() if line.startswith("automap ")]
    assert len(lines) >= 5
    for line in lines:
        done = subprocess.run(
            ["bash", "-c", line],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"


@pytest.mark.slow
def test_every_make_target_exists() -> None:
    targets = {line.split()[1] for line in commands() if line.startswith("make ")}
    targets |= set(re.findall(r"`make (\w+)`", README))
    assert {"demo", "test"} <= targets
    for target in targets:
        subprocess.run(["make", "--dry-run", target], cwd=ROOT, check=True, capture_output=True)


def test_every_linked_file_exists() -> None:
    links = re.findall(r"\]\(([^)#]+)\)", README)
    assert len(links) >= 2
    for link in links:
        assert (ROOT / link).is_file(), link


def test_every_kind_of_command_is_known() -> None:
    for line in commands():
        assert line.split()[0] in ("automap", "make"), f"no test runs: {line}"
    listed = set(re.findall(r"`automap (\w+)`", README))
    assert listed <= set(_COMMANDS), listed - set(_COMMANDS)


def test_it_stays_short() -> None:
    assert len(README.splitlines()) <= 150


def test_the_manifest_is_accepted(tmp_path: Path) -> None:
    (manifest,) = fences("toml")
    (tmp_path / "drive.toml").write_text(manifest, encoding="utf-8")
    content = tomllib.loads(manifest)
    (tmp_path / "video").mkdir()
    for name in (
        content["imu"]["file"],
        content["gnss"]["file"],
        *content["video"]["front"]["files"],
    ):
        (tmp_path / name).write_bytes(b"")
    drive = load_drive(tmp_path)
    assert drive.name == content["name"]
    assert drive.warnings == ()
