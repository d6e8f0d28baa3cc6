"""A second process that works while the first goes on."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from pipeline.shared.beside import T, ahead, beside, later

PARENT = """
import time
from pathlib import Path
from pipeline.shared.beside import beside

def work(folder):
    import os
    Path(folder, "child").write_text(str(os.getpid()))
    time.sleep(60)

if __name__ == "__main__":
    with beside(2) as begin:
        begin(work, {!r})()
"""


def test_the_other_process_ends_with_this_one(tmp_path: Path) -> None:
    (tmp_path / "parent.py").write_text(PARENT.format(str(tmp_path)))
    parent = subprocess.Popen([sys.executable, str(tmp_path / "parent.py")])
    told = tmp_path / "child"
    try:
        until = time.monotonic() + 60.0
        while not (told.is_file() and told.read_text()) and time.monotonic() < until:
            time.sleep(0.05)
        child = int(told.read_text())
    finally:
        parent.kill()
        parent.wait()
    until = time.monotonic() + 30.0
    while _runs(child) and time.monotonic() < until:
        time.sleep(0.05)
    assert not _runs(child)


def _runs(pid: int) -> bool:
    try:
        return "Z" not in Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False


def test_what_is_begun_is_waited_for_and_may_fail() -> None:
    with beside(2) as begin:
        assert begin is not later
        one, two = begin(os.getpid), begin(int, "x")
        assert one() != os.getpid()
        with pytest.raises(ValueError, match="invalid literal"):
            two()
    with beside(1) as begin:
        assert begin(os.getpid)() == os.getpid()


def test_no_more_is_begun_than_was_asked_for() -> None:
    """Ten thousand drives read ahead would not fit into memory."""
    begun: list[int] = []

    def begin(call: Callable[..., T], /, *words: object) -> Callable[[], T]:
        begun.append(len(begun))
        return later(call, *words)

    taken = []
    for result in ahead(begin, int, [(str(k),) for k in range(7)], 2):
        taken.append(result)
        assert len(begun) <= len(taken) + 2
    assert taken == list(range(7))
