"""Compiled code is not used when what it was compiled from has changed."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from automap.jit import KERNEL_FOLDERS, PACKAGE, drop_stale


def put(path: Path, text: str = "", age_s: float = 0.0) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    then = path.stat().st_mtime - age_s
    os.utime(path, (then, then))
    return path


@pytest.mark.parametrize("age_s", [0.0, 1e8])
def test_code_is_dropped_when_any_source_changes(tmp_path: Path, age_s: float) -> None:
    """Also by a source that is older than the code, as that of an installed package is."""
    folders = [tmp_path / "a", tmp_path / "b"]
    put(tmp_path / "a" / "caller.py")
    put(tmp_path / "b" / "callee.py")
    drop_stale(folders)
    code = put(tmp_path / "a" / "__pycache__" / "caller.nbi")
    drop_stale(folders)
    assert code.exists()
    put(tmp_path / "b" / "callee.py", "changed", age_s)
    drop_stale(folders)
    assert not code.exists()
    again = put(code)
    drop_stale(folders)
    assert again.exists()


def test_code_is_dropped_when_a_source_is_gone(tmp_path: Path) -> None:
    put(tmp_path / "caller.py")
    moved = put(tmp_path / "callee.py")
    drop_stale([tmp_path])
    code = put(tmp_path / "__pycache__" / "caller.nbi")
    moved.unlink()
    drop_stale([tmp_path])
    assert not code.exists()


def test_folders_without_anything_are_no_error(tmp_path: Path) -> None:
    drop_stale([tmp_path, tmp_path / "none"])


def test_every_kernel_is_watched_with_the_modules_that_it_is_compiled_from() -> None:
    watched = {PACKAGE / folder for folder in KERNEL_FOLDERS}
    users = [p for p in PACKAGE.rglob("*.py") if "from automap.jit import kernel" in p.read_text()]
    assert len(users) > 10
    assert {p.parent for p in users} <= watched
