"""A pytest plugin that writes down which functions of the project each passed test calls.

``AUTOMAP_CALLS`` names the file. Each of its lines is a test file as JSON: of each test its
seconds, those of what it shares with others (fixtures, and what is kept by ``functools``), and its
functions as ``path:qualified name``. What a shared thing calls counts for every test that takes it.
Tests over ``LIMIT_S`` are broken off and left out, the compiling of kernels not counted. Compiled
code is not seen.
"""

from __future__ import annotations

import functools
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest
from numba.core import event

LIMIT_S = 6.0
"""Tests that take longer are not asked."""

_ROOT = str(Path.cwd()) + os.sep
_OURS = tuple(_ROOT + name + os.sep for name in ("automap", "pipeline", "tests"))

called: set[CodeType] = set()
shared: dict[str, float] = {}
"""Of what a test shares with others the seconds that it took once."""
of_fixture: dict[int, tuple[set[CodeType], dict[str, float]]] = {}
"""What a fixture calls, and what it shares with others, itself included."""
spent_on_shared: list[float] = []
"""Seconds that went to shared things within the test that runs."""
told: dict[str, dict[str, Any]] = {}
passed: dict[str, bool] = {}


class _Compiling(event.Listener):  # type: ignore[misc]
    """Stops the clock while numba compiles."""

    def __init__(self) -> None:
        self.depth, self.begun, self.spent, self.left = 0, 0.0, 0.0, 0.0

    def on_start(self, event: Any) -> None:
        """The outermost counts: what is called is compiled within."""
        self.depth += 1
        if self.depth == 1:
            self.begun = time.process_time()
            self.left = signal.setitimer(signal.ITIMER_PROF, 0)[0]

    def on_end(self, event: Any) -> None:
        """The clock goes on."""
        self.depth -= 1
        if self.depth == 0:
            self.spent += time.process_time() - self.begun
            if self.left:
                signal.setitimer(signal.ITIMER_PROF, self.left, 0.5)


compiling = _Compiling()


def _seconds() -> float:
    return time.process_time() - compiling.spent


def _note(frame: FrameType, event: str, argument: object) -> None:
    called.add(frame.f_code)


def _too_long(number: int, frame: FrameType | None) -> None:
    pytest.fail("over the limit", pytrace=False)


def _remembering(kept: Callable[..., Any]) -> Callable[..., Any]:
    """``functools``' memory of a function, which remembers too what it called."""
    of_key: dict[Any, tuple[set[CodeType], str, float]] = {}

    @functools.wraps(kept)
    def call(*args: Any, **named: Any) -> Any:
        key = (args, tuple(sorted(named.items())))
        before, misses, inner = set(called), kept.cache_info().misses, len(spent_on_shared)  # type: ignore[attr-defined]
        called.clear()
        begun = _seconds()
        try:
            return kept(*args, **named)
        finally:
            if kept.cache_info().misses > misses:  # type: ignore[attr-defined]
                spent = _seconds() - begun - sum(spent_on_shared[inner:])
                spent_on_shared.append(spent)
                name = f"{kept.__module__}:{kept.__qualname__}:{len(of_key)}"
                of_key[key] = set(called), name, spent
            codes, name, spent = of_key.get(key, (set(), "", 0.0))
            if name:
                shared[name] = spent
            called.update(before | codes)

    call.cache_clear, call.cache_info = kept.cache_clear, kept.cache_info  # type: ignore[attr-defined]
    return call


def _is_ours(function: Any) -> bool:
    return getattr(function, "__module__", "").split(".")[0] in ("automap", "pipeline", "tests")


def _watch_memories() -> None:
    lru_cache = functools.lru_cache

    def watched(maxsize: Any = 128, typed: bool = False) -> Any:
        if callable(maxsize):
            kept = lru_cache(maxsize)
            return _remembering(kept) if _is_ours(maxsize) else kept

        def decorated(function: Any) -> Any:
            kept = lru_cache(maxsize, typed)(function)
            return _remembering(kept) if _is_ours(function) else kept

        return decorated

    functools.lru_cache = watched  # type: ignore[assignment]
    functools.cache = lambda function: watched(None)(function)  # type: ignore[assignment]


_watch_memories()


def pytest_sessionstart() -> None:
    """Begin to trace."""
    event.register("numba:compile", compiling)
    signal.signal(signal.SIGPROF, _too_long)
    sys.settrace(_note)
    threading.settrace(_note)


@pytest.hookimpl(hookwrapper=True)
def pytest_fixture_setup(fixturedef: Any) -> Iterator[None]:
    """Keep what a fixture calls."""
    before, outer = set(called), dict(shared)
    called.clear()
    shared.clear()
    begun, inner = _seconds(), len(spent_on_shared)
    yield
    # a fixture may have others set up
    spent = _seconds() - begun - sum(spent_on_shared[inner:])
    if fixturedef.scope != "function":
        spent_on_shared.append(spent)
        shared[f"{fixturedef.baseid}:{fixturedef.argname}"] = spent
    of_fixture[id(fixturedef)] = set(called), dict(shared)
    called.update(before)
    shared.update(outer)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Write down a test's functions and seconds."""
    called.clear()
    shared.clear()
    spent_on_shared.clear()
    sys.settrace(_note)  # who was broken off within it took it away
    signal.setitimer(signal.ITIMER_PROF, LIMIT_S, 0.5)
    begun = _seconds()
    yield
    seconds = _seconds() - begun
    signal.setitimer(signal.ITIMER_PROF, 0)
    for definitions in getattr(item, "_fixtureinfo").name2fixturedefs.values():  # noqa: B009
        for definition in definitions:
            codes, more = of_fixture.get(id(definition), (set(), {}))
            called.update(codes)
            shared.update(more)
    if passed.pop(item.nodeid, False):
        names = {_name(code) for code in [*called] if code.co_filename.startswith(_OURS)}
        told[item.nodeid] = {
            "seconds": round(max(seconds - sum(spent_on_shared), 0.0), 3),
            "shared": {name: round(s, 3) for name, s in shared.items() if s > 0.01},
            "calls": sorted(names),
        }


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Only what passes is of use."""
    passed[report.nodeid] = passed.get(report.nodeid, True) and report.passed


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """Write the line of a file whose last test this is, when the next begins."""
    _write_others(item.nodeid.split("::")[0])


def _write_others(now: str) -> None:
    done = {file for file in (test.split("::")[0] for test in told) if file != now}
    for file in sorted(done):
        tests = {test: told.pop(test) for test in [t for t in told if t.split("::")[0] == file]}
        with Path(os.environ["AUTOMAP_CALLS"]).open("a") as stream:
            stream.write(json.dumps({"file": file, "tests": tests}) + "\n")


def pytest_sessionfinish() -> None:
    """Write the last line."""
    sys.settrace(None)
    _write_others("")


def _name(code: CodeType) -> str:
    return f"{code.co_filename.removeprefix(_ROOT)}:{code.co_qualname.split('.<locals>')[0]}"
