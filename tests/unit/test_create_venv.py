"""Setting up the environment on systems that lack something, with stand-ins for the tools."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / ".ci" / "create-venv"

# a python that has no ensurepip until apt-get has been called
PYTHON = """
case "$*" in
  *version_info\\ \\<*) exit {old} ;;
  *ensurepip*) test -e {folder}/installed ;;
  *print*) echo python3.11-venv ;;
  --version) echo Python 3.9.2 ;;
  "-m venv"*) echo made > {folder}/made ;;
esac
"""


@pytest.fixture
def tools(tmp_path: Path) -> Path:
    """A folder with the stand-ins; the caller is not root and may not become it."""
    folder = tmp_path / "bin"
    folder.mkdir()
    put(folder, "python", PYTHON.format(old=0, folder=tmp_path))
    put(folder, "id", "echo 1000")
    put(folder, "sudo", "exit 1")
    put(folder, "apt-get", f'case "$*" in *install*venv*) touch {tmp_path}/installed;; esac')
    return folder


def put(folder: Path, name: str, body: str) -> None:
    path = folder / name
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(0o755)


def create(tools: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["/bin/bash", str(SCRIPT), str(tools / "python"), str(tools.parent / "venv")],
        env={"PATH": f"{tools}:/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=False,
    )


def test_with_everything_there(tools: Path) -> None:
    (tools.parent / "installed").touch()
    done = create(tools)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert (tools.parent / "made").exists()


@pytest.mark.parametrize("right", ["id", "sudo"])
def test_the_missing_package_is_installed_where_that_is_allowed(tools: Path, right: str) -> None:
    put(tools, *{"id": ("id", "echo 0"), "sudo": ("sudo", 'shift; "$@"')}[right])
    done = create(tools)
    assert done.returncode == 0, done.stderr
    assert (tools.parent / "installed").exists()
    assert (tools.parent / "made").exists()


def test_without_the_right_it_says_what_to_install(tools: Path) -> None:
    done = create(tools)
    assert done.returncode == 1
    assert "apt-get install python3.11-venv" in done.stderr
    assert done.stderr.count("\n") == 1


def test_an_old_python_is_told(tools: Path) -> None:
    put(tools, "python", PYTHON.format(old=1, folder=tools.parent))
    done = create(tools)
    assert done.returncode == 1
    assert "Python 3.9.2" in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_missing_python_is_told(tools: Path) -> None:
    (tools / "python").unlink()
    done = create(tools)
    assert done.returncode == 1
    assert "there is no" in done.stderr


def test_make_lets_python_keep_its_compiled_modules() -> None:
    """An image that forbids it has each of a thousand processes compile all it imports."""
    show = 'show: ; @echo "kept: [$$PYTHONDONTWRITEBYTECODE]"'
    told = subprocess.run(
        ["make", "--silent", "--eval", show, "show"],
        cwd=SCRIPT.parents[1],
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert told.stdout == "kept: []\n"
