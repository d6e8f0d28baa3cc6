"""What all tests share: where the real recordings are."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real recordings; the test is skipped where it is not there."""
    folder = Path(os.environ.get("AUTOMAP_SHARED_DATA") or PROJECT / ".." / "shared" / "data")
    if not folder.is_dir():
        pytest.skip(
            f"the real recordings are not at {folder}; name their folder in AUTOMAP_SHARED_DATA"
        )
    return folder.resolve()
