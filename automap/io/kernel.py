"""Loops that are compiled where that pays, and interpreted where it does not.

Importing numba and loading a compiled loop takes most of a second, in which the interpreter
gets through a megabyte. The source is the same either way, and so is every result: kernels
use only int64 and float64 arithmetic, which Python's own numbers share.
"""

from __future__ import annotations

import types
from collections.abc import Callable
from functools import cached_property
from typing import Any, Generic, ParamSpec, TypeVar

import numpy as np

P = ParamSpec("P")
R = TypeVar("R")

INTERPRET_BELOW = 1_500_000
"""Bytes of a log under which interpreting is faster than waiting for the compiler's start."""


def worth_compiling(log_bytes: int) -> bool:
    """Whether a log of so many bytes is large enough for compiled kernels."""
    return log_bytes >= INTERPRET_BELOW


class Kernel(Generic[P, R]):
    """A function of arrays and numbers that numba can compile.

    Called from another kernel it is part of that one, compiled or not. From outside use
    :meth:`run`.
    """

    def __init__(self, function: Callable[P, R]) -> None:
        self.function = function
        self.__doc__ = function.__doc__

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        return self.function(*args, **kwargs)

    @cached_property
    def compiled(self) -> Callable[..., R]:
        """The compiled function; its machine code is kept on disk from run to run."""
        from automap.jit import kernel

        function: Any = self.function
        scope = dict(function.__globals__)
        for name in function.__code__.co_names:
            if isinstance(scope.get(name), Kernel):
                scope[name] = scope[name].compiled
        copy = types.FunctionType(function.__code__, scope, function.__name__)
        copy.__qualname__, copy.__module__ = function.__qualname__, function.__module__
        compiled: Callable[..., R] = kernel(copy)
        return compiled

    def run(self, log_bytes: int, *args: Any) -> R:
        """Result for ``args`` (contiguous or strided arrays, numbers), of which those that the
        kernel writes to are changed; ``log_bytes`` is the size of the log that they are of."""
        if worth_compiling(log_bytes):
            return self.compiled(*args)
        # a memoryview gives Python's numbers, which numpy's scalars are slow beside
        function: Callable[..., R] = self.function
        return function(*(memoryview(a.data) if isinstance(a, np.ndarray) else a for a in args))
