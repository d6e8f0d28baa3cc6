"""What all tests share: where the real recordings are."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parent.parent


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--receiver",
        action="append",
        help="receivers of the Monte Carlo tests: white, or of configs/receivers; repeatable",
    )


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """A test that takes ``receiver_name`` runs with each that the option names."""
    if "receiver_name" in metafunc.fixturenames:
        names = metafunc.config.getoption("--receiver") or metafunc.module.RECEIVERS
        metafunc.parametrize("receiver_name", names, scope="module")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real recordings; the test is skipped where it is not there."""
    folder = Path(os.environ.get("AUTOMAP_SHARED_DATA") or PROJECT / ".." / "shared" / "data")
    if not folder.is_dir():
        pytest.skip(
            f"the real recordings are not at {folder}; name their folder in AUTOMAP_SHARED_DATA"
        )
    return folder.resolve()
