"""A run of the tests says how many of them could not run, and why."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parents[2]


def told(tmp_path: Path, *words: str) -> str:
    """What the recordings' tests print where there are no recordings."""
    nowhere = str(tmp_path / "no recordings")
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *words]
    done = subprocess.run(
        [*command, "tests/recordings/test_sync_recordings.py"],
        cwd=PROJECT,
        env=os.environ | {"AUTOMAP_SHARED_DATA": nowhere},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.slow
def test_the_summary_counts_what_lacks_recordings(tmp_path: Path) -> None:
    for words in ((), ("-n", "2")):
        text = told(tmp_path, *words)
        seen = re.search(r"(\d+) tests: the real recordings are not at (.*); name their", text)
        assert seen is not None, text
        assert seen.group(2) == str(tmp_path / "no recordings")
        last = re.search(r"(\d+) tests could not run", text)
        skipped = re.search(r"(\d+) skipped", text)
        assert last is not None
        assert int(last.group(1)) >= int(seen.group(1)) > 3
        assert skipped is None or skipped.group(1) == last.group(1)
