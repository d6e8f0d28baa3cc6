"""Work that is done by a second process while this one goes on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from multiprocessing import get_context
from typing import Protocol, TypeVar

T = TypeVar("T")


class Begin(Protocol):
    """Begins a call; what it returns waits for the result."""

    def __call__(self, call: Callable[..., T], /, *words: object) -> Callable[[], T]: ...


def later(call: Callable[..., T], /, *words: object) -> Callable[[], T]:
    """The call itself, by this process when its result is asked for."""
    return partial(call, *words)


@contextmanager
def beside(workers: int) -> Iterator[Begin]:
    """With two workers a process that makes one call after another; with one ``later``."""
    if workers < 2:
        yield later
        return
    # threads and locks of this process are no business of the other
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        yield lambda call, /, *words: pool.submit(call, *words).result
