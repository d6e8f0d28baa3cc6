"""One damaged file through its reader: what came of it."""

from __future__ import annotations

import logging
import os
import resource
import shutil
import signal
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from automap.errors import AutoMapError
from tests.fuzz.more_readers import SUFFIXES, more_reader
from tests.fuzz.places import kept
from tests.unit.broken_readers import reader_of

SLOW_S, HUNG_S = 10.0, 60.0
"""A reader's processor time for 64 KB, some ten times what the slowest takes, and time in all."""

MOST_MB = 400.0
"""That a reader of 64 KB may take; pictures of the largest size that is read take a half of it."""

MOST_CHARACTERS = 1000
"""Of an error's sentence; a garbled file must not be told back whole."""


@dataclass(frozen=True)
class Outcome:
    """``kind``: read, refused (one of our errors), or what is wrong; ``said``: its words."""

    kind: str
    said: str

    @property
    def good(self) -> bool:
        return self.kind in ("read", "refused")


def attempt(name: str, data: bytes) -> Outcome:
    """Read ``data`` as a file of the harness ``name``."""
    read = _reader(name)
    folder = _folder(os.getpid())
    path, work, aside = f"{folder}/{name}{_suffix(name)}", f"{folder}/work", f"{folder}/stderr"
    os.mkdir(work)
    with open(path, "wb") as file:
        file.write(data)
    _forget_peak()
    started, worked, before = time.monotonic(), time.process_time(), _peak_mb()
    ended = _when_slow()
    logging.disable(logging.CRITICAL)
    try:
        with warnings.catch_warnings(), _stderr_to(aside):
            warnings.simplefilter("error")
            read(Path(path), Path(work))
        outcome = Outcome("read", "")
    except _SlowError:
        outcome = Outcome("slow", name)
    except AutoMapError as error:
        said = str(error).replace(folder, "")
        whole = "\n" not in said and len(said) <= MOST_CHARACTERS
        outcome = Outcome("refused" if whole else "long sentence", said)
    except Exception as error:
        place = _ours(error)
        where = f"{type(error).__name__} {Path(place.filename).name}:{place.lineno}"
        kind = "warning" if isinstance(error, Warning) else "crash"
        outcome = Outcome(kind, f"{where} {str(error)[:200]}")
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, ended)
        logging.disable(logging.NOTSET)
    if outcome.good and os.path.getsize(aside):
        outcome = Outcome("stderr", Path(aside).read_text(errors="replace")[:200])
    _clear(folder)
    if outcome.good and _peak_mb() - before > MOST_MB:
        return Outcome("memory", f"{_peak_mb() - before:.0f} MB")
    hung = time.monotonic() - started > HUNG_S
    return Outcome("slow", name) if hung or time.process_time() - worked > SLOW_S else outcome


class _SlowError(BaseException):
    """No reader may catch it."""


def _when_slow() -> Any:
    """Break off what takes too long, where Python has a say; what it replaces."""

    def stop(number: int, frame: object) -> None:
        raise _SlowError

    ended = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, SLOW_S)
    return ended


@cache
def _reader(name: str) -> Callable[[Path, Path], object]:
    return more_reader(name) or reader_of(name)


@cache
def _folder(process: int) -> str:
    """Of all attempts of a process: making one for each takes longer than many readers."""
    return str(kept("attempts"))


def _clear(folder: str) -> None:
    for entry in os.scandir(folder):
        if entry.is_dir(follow_symlinks=False):
            shutil.rmtree(entry.path)
        else:
            os.unlink(entry.path)


@cache
def _suffix(name: str) -> str:
    """The ending of a harness's files."""
    if name in SUFFIXES:
        return SUFFIXES[name]
    if name == "phone_zip":
        return ".zip"
    return ".parquet" if name.endswith("_parquet") else ".dat"


def _ours(error: Exception) -> traceback.FrameSummary:
    """The last line of AutoMap's that an error went through."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [
        f for f in frames if f"{os.sep}automap{os.sep}" in f.filename or "pipeline" in f.filename
    ]
    return (ours or frames)[-1]


def _forget_peak() -> None:
    """Let the most memory so far be what the process has now, where the system can."""
    with suppress(OSError):
        file = os.open("/proc/self/clear_refs", os.O_WRONLY)
        try:
            os.write(file, b"5")
        finally:
            os.close(file)


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


@contextmanager
def _stderr_to(path: str) -> Iterator[None]:
    """Let libraries that write to the stream itself write to a file."""
    kept = os.dup(2)
    file = os.open(path, os.O_WRONLY | os.O_CREAT)
    os.dup2(file, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(file)
        os.close(kept)
