"""Compiled kernels always find a folder that can be written."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from pipeline.shared import kernel_cache


@pytest.fixture(autouse=True)
def _no_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    # set, then deleted: so that a value left by the test is taken back afterwards
    monkeypatch.setenv("NUMBA_CACHE_DIR", "x")
    monkeypatch.delenv("NUMBA_CACHE_DIR")


def test_a_package_that_can_be_written_needs_nothing() -> None:
    kernel_cache.ensure_kernel_cache()
    assert "NUMBA_CACHE_DIR" not in os.environ


def test_a_choice_of_the_user_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/mine")
    monkeypatch.setattr(kernel_cache, "_writable", lambda folder: False)
    kernel_cache.ensure_kernel_cache()
    assert os.environ["NUMBA_CACHE_DIR"] == "/mine"


@pytest.mark.parametrize("taken", [False, True])
def test_a_private_temporary_folder_serves_where_nothing_else_does(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, taken: bool
) -> None:
    monkeypatch.setattr(kernel_cache, "_writable", lambda folder: False)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    usual = tmp_path / f"automap-kernels-{os.getuid()}"
    if taken:
        usual.mkdir()
        usual.chmod(0o777)
    kernel_cache.ensure_kernel_cache()
    folder = Path(os.environ["NUMBA_CACHE_DIR"])
    assert (folder == usual) is not taken
    assert folder.stat().st_mode & 0o077 == 0


def test_what_cannot_be_written_is_seen(tmp_path: Path) -> None:
    assert kernel_cache._writable(tmp_path / "not" / "yet" / "there")
    assert not kernel_cache._writable(Path("/proc/self"))
