"""A pytest plugin that writes down which functions of the project each passed test calls.

``AUTOMAP_CALLS`` names the JSON file: of each test its seconds and its functions as
``path:qualified name``. What a shared fixture calls counts for every test that takes it, and what
the tests' own helpers keep (``functools.cache``) is forgotten before each. Tests over
``AUTOMAP_CALLS_LIMIT`` seconds are broken off and left out. Compiled code is not seen.
"""

from __future__ import annotations

import gc
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from functools import _lru_cache_wrapper
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest

_ROOT = str(Path.cwd()) + os.sep
_OURS = tuple(_ROOT + name + os.sep for name in ("automap", "pipeline"))
_LIMIT_S = float(os.environ.get("AUTOMAP_CALLS_LIMIT", "15"))

called: set[CodeType] = set()
of_fixture: dict[int, tuple[set[CodeType], float]] = {}
told: dict[str, dict[str, Any]] = {}
passed: dict[str, bool] = {}


def _note(frame: FrameType, event: str, argument: object) -> None:
    called.add(frame.f_code)


def _too_long(number: int, frame: FrameType | None) -> None:
    pytest.fail("over the limit", pytrace=False)


def pytest_sessionstart() -> None:
    """Begin to trace."""
    signal.signal(signal.SIGPROF, _too_long)
    sys.settrace(_note)
    threading.settrace(_note)


@pytest.hookimpl(hookwrapper=True)
def pytest_fixture_setup(fixturedef: Any) -> Iterator[None]:
    """Keep what a fixture calls."""
    before = set(called)
    called.clear()
    begun = time.process_time()
    yield
    of_fixture[id(fixturedef)] = set(called), time.process_time() - begun
    called.update(before)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Write down a test's functions and seconds."""
    for each in gc.get_objects():
        if isinstance(each, _lru_cache_wrapper) and (each.__module__ or "").startswith(
            ("tests.", "test_")
        ):
            each.cache_clear()
    called.clear()
    sys.settrace(_note)  # who was broken off within it took it away
    signal.setitimer(signal.ITIMER_PROF, _LIMIT_S, 0.5)
    begun = time.process_time()
    yield
    seconds = time.process_time() - begun
    signal.setitimer(signal.ITIMER_PROF, 0)
    codes = set(called)
    for definitions in getattr(item, "_fixtureinfo").name2fixturedefs.values():  # noqa: B009
        for definition in definitions:
            if definition.scope != "function" and id(definition) in of_fixture:
                more, spent = of_fixture[id(definition)]
                codes |= more
                seconds = max(seconds, spent)
    if passed.get(item.nodeid):
        names = {_name(code) for code in codes if code.co_filename.startswith(_OURS)}
        told[item.nodeid] = {"seconds": round(seconds, 3), "calls": sorted(names)}


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Only what passes is of use."""
    passed[report.nodeid] = passed.get(report.nodeid, True) and report.passed


def pytest_sessionfinish() -> None:
    """Write the file."""
    sys.settrace(None)
    Path(os.environ["AUTOMAP_CALLS"]).write_text(json.dumps(told))


def _name(code: CodeType) -> str:
    return f"{code.co_filename.removeprefix(_ROOT)}:{code.co_qualname.split('.<locals>')[0]}"
