"""Work that is done by a second process while this one goes on."""

from __future__ import annotations

import ctypes
import os
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from multiprocessing import get_context
from typing import Protocol, TypeVar

T = TypeVar("T")
_SET_DEATH_SIGNAL = 1
"""``PR_SET_PDEATHSIG`` of Linux' prctl.h."""


class Begin(Protocol):
    """Begins a call; what it returns waits for the result."""

    def __call__(self, call: Callable[..., T], /, *words: object) -> Callable[[], T]: ...


def later(call: Callable[..., T], /, *words: object) -> Callable[[], T]:
    """The call itself, by this process when its result is asked for."""
    return partial(call, *words)


def processes(count: int) -> ProcessPoolExecutor:
    """So many processes, which end with this one however it ends: what they wrote after that would
    come into the files of the next attempt."""
    # threads and locks of this process are no business of the others
    return ProcessPoolExecutor(count, get_context("spawn"), _end_with, (os.getpid(),))


def _end_with(parent: int) -> None:
    try:
        ctypes.CDLL(None).prctl(_SET_DEATH_SIGNAL, signal.SIGKILL)
    except (AttributeError, OSError):
        # other systems have no such call
        return
    if os.getppid() != parent:
        os._exit(1)


@contextmanager
def beside(workers: int, count: int = 1) -> Iterator[Begin]:
    """With two workers so many processes that make one call after another; with one ``later``."""
    if workers < 2:
        yield later
        return
    with processes(count) as pool:
        yield lambda call, /, *words: pool.submit(call, *words).result


def ahead(
    begin: Begin, call: Callable[..., T], words: Iterable[Sequence[object]], most: int
) -> Iterator[T]:
    """Results of calls in their order, of which ``most`` are begun before they are asked for: more
    would fill the memory."""
    begun: deque[Callable[[], T]] = deque()
    for each in words:
        begun.append(begin(call, *each))
        if len(begun) > most:
            yield begun.popleft()()
    while begun:
        yield begun.popleft()()
