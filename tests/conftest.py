"""What all tests share: where the real recordings are, and what is told of tests left out."""

from __future__ import annotations

import os
import signal
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import settings

# as the command has it: a second thread of a small product waits for the first more than it
# brings, and the tests fill the cores by themselves; read when numpy is first imported
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

PROJECT = Path(__file__).resolve().parent.parent


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--receiver",
        action="append",
        help="receivers of the Monte Carlo tests: white, or of configs/receivers; repeatable",
    )


def pytest_configure() -> None:
    """Give examples all the time they take, and have interrupts end what is tested, also where a
    shell began all this in the background, which ignores them."""
    # how long an example takes hangs on what else the machine does
    settings.register_profile("automap", deadline=None)
    settings.load_profile("automap")
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


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


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say how many tests could not run and why: a dot that is an s is easily passed over."""
    why: Counter[str] = Counter()
    for report in terminalreporter.stats.get("skipped", []):
        # file, line, reason
        told = report.longrepr[-1] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        reason = " ".join(str(told).removeprefix("Skipped: ").split())
        why["an empty list of cases" if reason.startswith("got empty parameter") else reason] += 1
    if not why:
        return
    terminalreporter.section("could not run")
    for reason, count in why.most_common():
        terminalreporter.line(f"{count:5} {'tests' if count > 1 else 'test'}: {reason}")
    terminalreporter.line(
        f"{sum(why.values())} tests could not run; whole files that lack a package count as one."
    )
