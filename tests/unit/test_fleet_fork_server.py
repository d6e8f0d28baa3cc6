"""The process from which drives' processes are forked."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pipeline.fleet.fork_server import ForkServer, end_idle, fork_server
from pipeline.settings.load import load_settings


@pytest.fixture
def server() -> Iterator[ForkServer]:
    started = ForkServer()
    yield started
    started.end()


def _request(folder: Path, name: str) -> Path:
    """For a drive that is not there."""
    own = folder / name
    own.mkdir()
    told = {
        "drive": str(folder / f"no-{name}"),
        "out": str(own / "out"),
        "answer": str(own / "answer.json"),
        "settings": load_settings(None, ()).echo(),
        "outside": [],
    }
    (own / "request.json").write_text(json.dumps(told, default=str))
    return own / "request.json"


def _answer(request: Path) -> dict[str, Any]:
    told: dict[str, Any] = json.loads((request.parent / "answer.json").read_text())
    return told


@pytest.mark.slow
def test_requests_are_answered_one_after_the_other_and_modules_stay(
    server: ForkServer, tmp_path: Path
) -> None:
    def holds_numpy() -> bool:
        return "_multiarray" in Path(f"/proc/{server._process.pid}/maps").read_text()

    assert not holds_numpy()
    # whatever began the worker: one thread, and arrays that take what is in them
    environment = Path(f"/proc/{server._process.pid}/environ").read_bytes().split(b"\0")
    assert {b"OMP_NUM_THREADS=1", b"NUMPY_MADVISE_HUGEPAGE=0"} <= {*environment}
    for name in ("first", "second"):
        request = _request(tmp_path, name)
        assert server.run(request, lambda pid: None, 0.2) == 0
        assert _answer(request)["kind"] == "data"
        assert f"no-{name}" in _answer(request)["error"]
        assert holds_numpy()
        assert server.runs()


@pytest.mark.slow
def test_a_process_that_fails_ends_with_1_and_the_next_is_unharmed(
    server: ForkServer, tmp_path: Path
) -> None:
    bad = tmp_path / "bad" / "request.json"
    bad.parent.mkdir()
    bad.write_text("{")
    assert server.run(bad, lambda pid: None, 0.2) == 1
    assert "JSONDecodeError" in (bad.parent / "log").read_text()
    good = _request(tmp_path, "good")
    assert server.run(good, lambda pid: None, 0.2) == 0


def _slow(folder: Path) -> Path:
    """A request that waits until somebody writes what is asked."""
    own = folder / "slow"
    own.mkdir()
    os.mkfifo(own / "request.json")
    return own / "request.json"


@pytest.mark.slow
def test_a_killed_process_is_told_by_its_signal(server: ForkServer, tmp_path: Path) -> None:
    killed = server.run(_slow(tmp_path), lambda pid: os.kill(pid, signal.SIGKILL), 0.05)
    assert killed == -signal.SIGKILL
    assert server.run(_request(tmp_path, "next"), lambda pid: None, 0.2) == 0


@pytest.mark.slow
def test_a_killed_server_counts_as_a_killed_process(tmp_path: Path) -> None:
    forked: list[int] = []

    def kill(pid: int) -> None:
        forked.append(pid)
        os.kill(first._process.pid, signal.SIGKILL)

    with fork_server() as first:
        assert first.run(_slow(tmp_path), kill, 0.05) == -signal.SIGKILL
    until = time.monotonic() + 60.0
    while Path(f"/proc/{forked[0]}").exists():
        # what it had forked ends with it
        assert time.monotonic() < until
        time.sleep(0.05)
    with fork_server() as second:
        assert second is not first
        assert second.run(_request(tmp_path, "next"), lambda pid: None, 0.2) == 0
    with fork_server() as third:
        assert third is second
    end_idle()
    assert not second.runs()
