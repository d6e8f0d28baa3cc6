"""Compiled code is not used when what it was compiled from has changed."""

from __future__ import annotations

import os
from pathlib import Path

from automap.jit import KERNEL_FOLDERS, PACKAGE, drop_stale


def put(path: Path, age_s: float) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("")
    then = path.stat().st_mtime - age_s
    os.utime(path, (then, then))
    return path


def test_code_older_than_any_source_is_dropped(tmp_path: Path) -> None:
    put(tmp_path / "a" / "caller.py", 100.0)
    put(tmp_path / "b" / "callee.py", 10.0)
    old = put(tmp_path / "a" / "__pycache__" / "caller.nbi", 50.0)
    new = put(tmp_path / "b" / "__pycache__" / "callee.nbi", 5.0)
    drop_stale([tmp_path / "a", tmp_path / "b"])
    assert not old.exists()
    assert new.exists()


def test_folders_without_anything_are_no_error(tmp_path: Path) -> None:
    drop_stale([tmp_path, tmp_path / "none"])


def test_every_kernel_is_watched_with_the_modules_that_it_is_compiled_from() -> None:
    watched = {PACKAGE / folder for folder in KERNEL_FOLDERS}
    users = [p for p in PACKAGE.rglob("*.py") if "from automap.jit import kernel" in p.read_text()]
    assert len(users) > 10
    assert {p.parent for p in users} <= watched
