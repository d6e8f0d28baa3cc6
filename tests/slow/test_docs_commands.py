"""Every runnable command of the documentation runs, page by page, in the order of the pages."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import cv2
import pytest

from tests.docs_commands import DOCS, ROOT, commands, files, pages, scripts

SAMPLE = ROOT / "data" / "sample-drive"
# the tutorial makes the map that other pages start from
ORDER = ["tutorial.md", "howto/review.md"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the sample drive and the command ``automap`` of this checkout."""
    if not (SAMPLE / "drive.toml").is_file():
        pytest.skip("data/sample-drive is not there")
    root = tmp_path_factory.mktemp("docs")
    shutil.copytree(
        SAMPLE, root / "data" / "sample-drive", ignore=shutil.ignore_patterns("_automap")
    )
    launcher = root / "bin" / "automap"
    launcher.parent.mkdir()
    launcher.write_text(
        f"#!/bin/sh\nexec {sys.executable} -c 'from pipeline.cli import main; main()' \"$@\"\n"
    )
    launcher.chmod(0o755)
    # the picture that the detector's page looks at: a stop sign close by
    video = cv2.VideoCapture(str(SAMPLE / "video" / "front.mp4"))
    video.set(cv2.CAP_PROP_POS_FRAMES, 290)
    _, picture = video.read()
    assert cv2.imwrite(str(root / "street.jpg"), picture)
    return root


def in_order() -> list[Path]:
    """The pages, those first that others rest on."""
    names = [str(page.relative_to(DOCS)) for page in pages()]
    return [DOCS / name for name in [*ORDER, *(n for n in names if n not in ORDER)]]


@pytest.mark.slow
@pytest.mark.parametrize("page", in_order(), ids=lambda page: str(page.relative_to(DOCS)))
def test_every_command_and_script_of_a_page_runs(folder: Path, page: Path) -> None:
    environment = {
        **os.environ,
        "PATH": f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        # a browser that shows nothing
        "BROWSER": "true",
    }
    for name, content in files(page).items():
        (folder / name).write_text(content, encoding="utf-8")
    for command in commands(page):
        if not command.runnable:
            continue
        if command.words[1] == "view":
            serve(command.line, folder, environment)
            continue
        done = subprocess.run(
            ["bash", "-c", command.line],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{command.line}\n{done.stdout}\n{done.stderr}"
    for script in scripts(page):
        done = subprocess.run(
            [sys.executable, "-c", script],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{script}\n{done.stderr}"
        assert done.stdout.strip(), script


def serve(line: str, folder: Path, environment: dict[str, str]) -> None:
    """A viewer says where it is and ends on Ctrl-C."""
    child = subprocess.Popen(
        ["bash", "-c", f"exec {line}"],
        cwd=folder,
        env={**environment, "PYTHONUNBUFFERED": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert child.stdout is not None
    said = child.stdout.readline()
    child.send_signal(signal.SIGINT)
    _, trouble = child.communicate(timeout=60)
    assert said.startswith("http://127.0.0.1:"), trouble
    assert child.returncode == 0, trouble
