"""How the kernels are compiled, and when what was compiled is still what the sources say."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from inspect import getfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numba import njit

ROOT = Path(__file__).resolve().parent.parent
_IMPORT = re.compile(r"^from (automap[\w.]*) import (\([^)]*\)|.*)|^import (automap[\w.]*)", re.M)


def kernel_with(**options: Any) -> Any:
    """Decorator of the numba functions; ``options`` are numba's own.

    Divisions by zero give infinity instead of a check at every division. Sums stay in the order in
    which they are written and nothing is fused: what a compiler may choose it chooses anew where
    it compiles a caller beside its callee or finds that one compiled, and close decisions with it.

    The machine code is kept on disk. Numba compiles a function anew when its own file changes, not
    when a function or a constant that it takes from another file does; so the digest of all files
    that the function's module imports, and these import, stands in the stamp that numba compares.
    """

    def decorated(function: Any) -> Any:
        compiled = njit(cache=True, error_model="numpy", **options)(function)
        # there is none where numba is told to leave everything interpreted
        kept = getattr(compiled, "_cache", None)
        if kept is not None:
            file = kept._cache_file
            file._source_stamp = (file._source_stamp, digest_of_sources(Path(getfile(function))))
            file._load_index = _or_else(file._load_index, dict)
            file.load = _or_else(file.load, lambda: None)
        return compiled

    return decorated


def _or_else(read: Callable[..., Any], nothing: Callable[[], Any]) -> Callable[..., Any]:
    """``read``, but ``nothing`` where what is kept can't be read: cut off as the power went, or of
    a version with a class that there is no more. Then it is compiled again."""

    def guarded(*args: Any) -> Any:
        try:
            return read(*args)
        except Exception:  # unpickling what is damaged raises anything
            return nothing()

    return guarded


# to a checker it is numba's own, which has the functions' types
kernel = njit(cache=True, error_model="numpy") if TYPE_CHECKING else kernel_with()
"""The decorator without options."""


@cache
def digest_of_sources(path: Path) -> str:
    """A digest of the content of a source and of all of AutoMap's that it imports."""
    whole = sha256()
    for source in sorted(sources_of(path)):
        whole.update(source.name.encode() + b"\0" + _content(source))
    return whole.hexdigest()


def sources_of(path: Path) -> set[Path]:
    """The files of a module and of AutoMap's modules that it imports, directly or by others.

    Only imports at the top count: a kernel can have no others.
    """
    found: set[Path] = set()
    waiting = {path}
    while waiting:
        source = waiting.pop()
        found.add(source)
        waiting |= _imported(source) - found
    return found


@cache
def _content(path: Path) -> bytes:
    return path.read_bytes()


@cache
def _imported(path: Path) -> frozenset[Path]:
    modules: set[str] = set()
    for module, named, plain in _IMPORT.findall(_content(path).decode("utf-8")):
        # a name may be a module of a package
        modules |= {module or plain, *(f"{module}.{name}" for name in re.findall(r"\w+", named))}
    places = (ROOT.joinpath(*name.split(".")) for name in modules)
    files = (each for place in places for each in (place.with_suffix(".py"), place / "__init__.py"))
    return frozenset(file for file in files if file.is_file())
