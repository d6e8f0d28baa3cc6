"""Asks tests of mistakes, each in a fork of a process that has loaded the heavy libraries.

``python -m tests.mutation.worker FOLDER``: a copy of the project. A line of standard input is
``{"source", "text", "plain", "tests", "seconds"}`` as JSON, the answer ``[state, by,
seconds of tests that pass]``; ``plain`` are the kernels that are interpreted, ``tests`` pairs of a
test and its seconds.

Kernels that hold the mistake, and those that they are compiled into, are interpreted; all others
come from the machine code of the sound sources, so that nothing is compiled. What fails there, or
takes too long, has to pass on the sound sources in the same way: else the test says nothing.
"""

from __future__ import annotations

import importlib
import json
import os
import resource
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import IO, Any

import pytest
from numba.core import event

from automap import jit
from tests.mutation.asked import INTERPRETED

_HEAVY = (
    *("numpy", "scipy.optimize", "scipy.linalg", "scipy.spatial", "scipy.stats"),
    *("scipy.special", "scipy.signal", "scipy.ndimage", "pyarrow.parquet", "pydantic", "click"),
    *("pytest", "hypothesis", "numba"),
)

_BYTES = 6 << 30
"""Of memory at most: some mistakes make an array grow without end."""

_LIMIT_S = 8.0
"""Of a test, before it is broken off."""

_COMPILING_S = 60.0
"""For that at most."""

_CLEAR = 3.0
"""A mistake makes a test too long if it takes so many times less without it."""


class Stamp:
    """What the kept machine code of the sound sources is known by."""

    def __init__(self) -> None:
        self.of: dict[str, tuple[Any, str]] = {}
        for path in jit.ROOT.joinpath("automap").rglob("*.py"):
            told = path.stat()
            self.of[str(path)] = (told.st_mtime, told.st_size), jit.digest_of_sources(path)


class Compiling(event.Listener):  # type: ignore[misc]
    """Stops the clock while numba compiles: a mistake may give a kernel arrays of another kind."""

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
                signal.setitimer(signal.ITIMER_PROF, self.left, 1.0)

    def seconds(self) -> float:
        """Of the processor, without those of compiling."""
        return time.process_time() - self.spent


class Watch:
    """A pytest plugin: breaks tests off that take too long, and writes down what happens."""

    def __init__(self, whole_s: float, told: IO[str]) -> None:
        self.whole_s, self.told = whole_s, told
        self.now, self.compiling = "", Compiling()
        event.register("numba:compile", self.compiling)
        signal.signal(signal.SIGPROF, self._too_long)

    def tell(self, what: str, text: str) -> None:
        """A line that is there whatever happens next."""
        self.told.write(json.dumps([what, self.now, text, self.compiling.seconds()]) + "\n")
        self.told.flush()

    def _too_long(self, number: int, frame: FrameType | None) -> None:
        self.tell("long", "")
        pytest.skip("too long")

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        """Watch the time."""
        self.now = item.nodeid
        self.tell("begun", "")
        signal.setitimer(signal.ITIMER_PROF, _LIMIT_S, 1.0)
        yield
        signal.setitimer(signal.ITIMER_PROF, 0)
        if self.compiling.seconds() > self.whole_s:
            item.session.shouldstop = "no time left"

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Write down what failed, or that it passed."""
        if report.failed or report.when == "call":
            self.tell(report.outcome, str(report.longrepr)[-300:] if report.failed else "")

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """A file that cannot be imported fails."""
        if report.failed:
            self.now = report.nodeid
            self.tell("failed", str(report.longrepr)[-300:])


def _with_kept_code(stamp: Stamp, plain: set[str]) -> None:
    """Have kernels made of the sound machine code, and some of them left interpreted."""
    made = jit_module().kernel_with

    def kernel_with(**options: Any) -> Callable[[Any], Any]:
        def decorated(function: Any) -> Any:
            file = function.__code__.co_filename
            if f"{os.path.relpath(file, jit.ROOT)}:{function.__qualname__}" in plain:
                return function
            compiled = made(**options)(function)
            if file in stamp.of and getattr(compiled, "_cache", None) is not None:
                compiled._cache._cache_file._source_stamp = stamp.of[file]
            return compiled

        return decorated

    jit_module().kernel_with = kernel_with
    jit_module().kernel = kernel_with()


def jit_module() -> Any:
    """The module as it is imported now."""
    return importlib.import_module("automap.jit")


def _load() -> None:
    for name in _HEAVY:
        importlib.import_module(name)


def write(path: Path, text: str) -> None:
    """Have a source say something else from now on."""
    path.write_text(text)
    # python's own compiled files go by size and time to the second
    for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
        compiled.unlink()


Told = list[tuple[str, str, str, float]]
"""What happened, with which test, more about it, seconds of the processor since the fork."""


class Asker:
    """Asks the tests of one mistake after the other."""

    def __init__(self, root: Path) -> None:
        self.root, self.stamp = root, Stamp()
        self._sound: dict[tuple[str, frozenset[str]], float | None] = {}

    def ask(self, job: dict[str, Any]) -> tuple[str, str, dict[str, float]]:
        """Whether one of the tests notices, which, and what those took that pass."""
        tests = [name for name, _ in job["tests"]]
        plain, left = frozenset(job["plain"]), float(job["seconds"])
        silent: list[str] = []
        taken: dict[str, float] = {}

        seconds = dict(job["tests"])

        def asked(test: str) -> str:
            return test if test in seconds else test.split("[")[0]

        def key(test: str) -> str:
            return f"{asked(test)}{INTERPRETED if plain else ''}"

        while tests and left > 0.0:
            told = self._with(job, plain, tests, left)
            left -= max((at for *_, at in told), default=0.0)
            for what, test, text, _ in told:
                if what == "passed":
                    taken[key(test)] = max(taken.get(key(test), 0.0), _took(told, test))
                if what not in ("failed", "long", "died"):
                    continue
                if what == "long":
                    taken[key(test)] = _LIMIT_S  # to be asked last
                    if silent:
                        continue  # one tells whether it is the mistake
                known = what == "failed" and not plain and seconds.get(asked(test))
                sound_s = known or self._sound_s(test, plain)
                took_s = _took(told, test)
                if sound_s is None or (what != "failed" and sound_s * _CLEAR > took_s):
                    silent.append(test)  # it says nothing in this way of running
                    continue
                why = text if what == "failed" else f"{what}: {took_s:.0f} s, {sound_s:.1f} else"
                return "killed", f"{test} - {' '.join(why.split())[-200:]}", taken
            what, last = (told[-1][0], asked(told[-1][1])) if told else ("", "")
            if what not in ("failed", "died") or last not in tests:
                break
            tests = tests[tests.index(last) + 1 :]
        by = f"{len(taken)} tests" + (f", silent {len(silent)}: {silent[0]}" if silent else "")
        return "survived", by, taken

    def _with(
        self, job: dict[str, Any], plain: frozenset[str], tests: list[str], left: float
    ) -> Told:
        path = self.root / job["source"]
        right, times = path.read_text(), path.stat()
        try:
            write(path, job["text"])
            return self._forked(plain, tests, left)
        finally:
            write(path, right)
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))

    def _sound_s(self, test: str, plain: frozenset[str]) -> float | None:
        """The seconds of a test that passes on the sound sources, or None."""
        key = test, plain
        if key not in self._sound:
            told = self._forked(plain, [test], 2.0 * _LIMIT_S)
            passed = bool(told) and all(what in ("begun", "passed") for what, *_ in told)
            self._sound[key] = _took(told, told[-1][1]) if passed else None
        return self._sound[key]

    def _forked(self, plain: frozenset[str], tests: list[str], left: float) -> Told:
        with tempfile.TemporaryFile("w+") as told:
            child = os.fork()
            if child == 0:
                hard_s = round(left + 3.0 * _LIMIT_S + _COMPILING_S)
                resource.setrlimit(resource.RLIMIT_CPU, (hard_s, hard_s))
                resource.setrlimit(resource.RLIMIT_AS, (_BYTES, _BYTES))
                signal.alarm(10 * hard_s)  # who waits for ever uses no processor
                self._run(plain, tests, left, told)
            status = os.waitstatus_to_exitcode(os.wait4(child, 0)[1])
            told.seek(0)
            lines = [tuple(json.loads(line)) for line in told.read().splitlines()]
            if status < 0 or not lines:
                at = lines[-1][1] if lines else tests[0]
                lines.append(("died", at, f"ended with {status}", left))
            return lines

    def _run(self, plain: frozenset[str], tests: list[str], left: float, told: IO[str]) -> None:
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, 1)
        os.dup2(nothing, 2)
        os.chdir(self.root)
        for name in [n for n in sys.modules if n.split(".")[0] in ("tests", "automap", "pipeline")]:
            del sys.modules[name]
        try:
            watch = Watch(left, told)
            watch.now = tests[0]
            _with_kept_code(self.stamp, set(plain))
            options = ["-x", "-q", "--tb=line", "-p", "no:cacheprovider", "-p", "no:xdist"]
            pytest.main([*options, *tests], plugins=[watch])
        except BaseException as error:  # the mistake may be in what is imported first
            watch.tell("failed", repr(error))
        finally:
            told.flush()
            os._exit(0)


def _took(told: Told, test: str) -> float:
    times = [at for _, name, _, at in told if name == test]
    return max(times) - min(times) if times else 0.0


def main() -> None:
    """Answer until there are no more lines."""
    asker = Asker(Path(sys.argv[1]))
    _load()
    for line in sys.stdin:
        print(json.dumps(asker.ask(json.loads(line))), flush=True)


if __name__ == "__main__":
    main()
