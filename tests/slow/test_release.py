"""A release is the same bytes from the same sources, wherever and whenever it is built."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
PARTS = ("automap", "pipeline", "configs", "docs", "tests", "release", "pyproject.toml")
PARTS += ("README.md", "LICENSE", ".gitignore", "Makefile")


def built(folder: Path, epoch_s: int, when_s: int, mask: int) -> dict[str, bytes]:
    """Wheel and sdist of a copy of the sources whose files are of another time."""
    skipped = shutil.ignore_patterns("__pycache__", "*.nbi", "*.nbc", "*.pyc")
    folder.mkdir(parents=True)
    for part in PARTS:
        source = ROOT / part
        if source.is_dir():
            shutil.copytree(source, folder / part, ignore=skipped)
        else:
            shutil.copyfile(source, folder / part)
    for path in folder.rglob("*"):
        os.utime(path, (when_s, when_s))
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-d", "made"],
        cwd=folder,
        env=os.environ | {"SOURCE_DATE_EPOCH": str(epoch_s)},
        check=True,
        capture_output=True,
        umask=mask,
    )
    return {path.name: path.read_bytes() for path in (folder / "made").iterdir()}


def test_a_release_is_the_same_bytes_wherever_it_is_built(tmp_path: Path) -> None:
    if importlib.util.find_spec("hatchling") is None:
        pytest.skip("hatchling is not installed; requirements-build.lock names it")
    first = built(tmp_path / "a", 1_700_000_000, 1_600_000_000, 0o022)
    second = built(tmp_path / "elsewhere" / "b", 1_700_000_000, 1_650_000_000, 0o077)
    assert sorted(Path(name).suffix for name in first) == [".gz", ".whl"]
    assert first.keys() == second.keys()
    assert [name for name in first if first[name] != second[name]] == []
    # what would differ is seen
    assert built(tmp_path / "c", 1_700_086_400, 1_600_000_000, 0o022) != first
