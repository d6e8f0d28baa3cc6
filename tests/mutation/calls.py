"""A pytest plugin that writes down which functions of the project each passed test calls.

``AUTOMAP_CALLS`` names the JSON file: of each test its seconds, those of the shared fixtures that
it takes, and its functions as ``path:qualified name``. What a shared fixture calls counts for every
test that takes it, and what the tests' own helpers keep (``functools.cache``) is forgotten before
each. Tests over ``AUTOMAP_CALLS_LIMIT`` seconds are broken off and left out. Compiled code is not
seen.
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
"""What a fixture calls, and its seconds."""
spent_on_shared: list[float] = []
"""Seconds of the shared fixtures set up within the test that runs."""
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
    begun, inner = time.process_time(), len(spent_on_shared)
    yield
    # a fixture may have others set up
    spent = time.process_time() - begun - sum(spent_on_shared[inner:])
    of_fixture[id(fixturedef)] = set(called), spent
    if fixturedef.scope != "function":
        spent_on_shared.append(spent)
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
    spent_on_shared.clear()
    sys.settrace(_note)  # who was broken off within it took it away
    signal.setitimer(signal.ITIMER_PROF, _LIMIT_S, 0.5)
    begun = time.process_time()
    yield
    seconds = time.process_time() - begun
    signal.setitimer(signal.ITIMER_PROF, 0)
    codes, shared = set(called), {}
    for definitions in getattr(item, "_fixtureinfo").name2fixturedefs.values():  # noqa: B009
        for definition in definitions:
            if definition.scope != "function" and id(definition) in of_fixture:
                more, spent = of_fixture[id(definition)]
                codes |= more
                shared[f"{definition.baseid}:{definition.argname}"] = round(spent, 3)
    own = max(seconds - sum(spent_on_shared), 0.0)
    if passed.get(item.nodeid):
        names = {_name(code) for code in codes if code.co_filename.startswith(_OURS)}
        told[item.nodeid] = {"seconds": round(own, 3), "shared": shared, "calls": sorted(names)}


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Only what passes is of use."""
    passed[report.nodeid] = passed.get(report.nodeid, True) and report.passed


def pytest_sessionfinish() -> None:
    """Write the file."""
    sys.settrace(None)
    Path(os.environ["AUTOMAP_CALLS"]).write_text(json.dumps(told))


def _name(code: CodeType) -> str:
    return f"{code.co_filename.removeprefix(_ROOT)}:{code.co_qualname.split('.<locals>')[0]}"
