"""Which functions a line of a source may change, and which kernels are compiled from them."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from tests.mutation.areas import PROJECT, imported

_KERNEL = re.compile(r"kernel|kernel_with\(.*\)", re.DOTALL)


class Function(NamedTuple):
    """A function of the project, the words that it names, and whether it is compiled."""

    path: str
    name: str
    words: frozenset[str]
    kernel: bool

    def __str__(self) -> str:
        return f"{self.path}:{self.name}"


def functions_of(source: Path, line: int) -> set[str]:
    """The functions, ``path:qualified name``, that a line of a source may change.

    Of a line within a function it is that one; of a constant or a field all functions of the
    project that name it.
    """
    place, names = _place(source, line)
    if place:
        return {f"{source}:{place}"}
    words = set(names)
    for _ in range(3):  # constants of constants
        words |= {n for n, used in _constants() if not words.isdisjoint(used)}
    return {str(f) for f in _functions() if not words.isdisjoint(f.words)}


def kernels_from(changed: set[str]) -> set[str]:
    """Of changed functions the kernels, and all kernels that these are compiled into."""
    found = {f for f in _functions() if f.kernel and str(f) in changed}
    while True:
        more = {f for f in _naming(found) if f.kernel} - found
        if not more:
            return {str(f) for f in found}
        found |= more


def callers_of(kernels: set[str]) -> set[str]:
    """The functions that name one of some kernels: no trace sees a compiled call."""
    return {str(f) for f in _naming({f for f in _functions() if str(f) in kernels})}


def _naming(kernels: set[Function]) -> Iterator[Function]:
    for function in _functions():
        for kernel in kernels:
            if kernel.name in function.words and kernel.path in _origins(
                function.path, kernel.name
            ):
                yield function
                break


@cache
def _origins(path: str, word: str) -> frozenset[str]:
    """The files in which a word that a source uses may be defined."""
    found = {path} | {str(i) for i in imported(PROJECT, Path(path))}
    for each in [*found]:  # a front that hands on what others define
        found |= {str(i) for i in imported(PROJECT, Path(each)) if word in _handed_on(each)}
    return frozenset(found)


@cache
def _handed_on(path: str) -> frozenset[str]:
    trees = [tree for name, tree in _trees() if name == path]
    nodes = [n for tree in trees for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
    return frozenset(alias.asname or alias.name for n in nodes for alias in n.names)


def _place(source: Path, line: int) -> tuple[str, set[str]]:
    node: Any = dict(_trees())[str(source)]
    within: list[str] = []
    names: set[str] = set()
    while True:
        inner = [n for n in node.body if n.lineno <= line <= (n.end_lineno or n.lineno)]
        if not inner:
            return "", names
        node = inner[0]
        if isinstance(node, ast.FunctionDef) and line >= node.body[0].lineno:
            return ".".join([*within, node.name]), set()
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            names = {node.name}
            within.append(node.name)
            if isinstance(node, ast.FunctionDef):
                return ".".join(within), set()
            continue
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        words = {w for t in targets if t is not None for w in re.findall(r"\w+", ast.unparse(t))}
        return "", words or names


@cache
def _trees() -> list[tuple[str, ast.Module]]:
    places = [PROJECT / name for name in ("automap", "pipeline", "tests/unit")]
    paths = [path for place in places for path in place.rglob("*.py")]
    return [(str(p.relative_to(PROJECT)), ast.parse(p.read_text())) for p in paths]


def _words(node: ast.AST) -> frozenset[str]:
    named = (getattr(n, "id", getattr(n, "attr", None)) for n in ast.walk(node))
    return frozenset(word for word in named if word)


@cache
def _constants() -> list[tuple[str, frozenset[str]]]:
    return [
        (name, _words(node.value))
        for path, tree in _trees()
        if not path.startswith("tests")
        for node in tree.body
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
        for name in re.findall(r"\w+", ast.unparse(target))
    ]


@cache
def _functions() -> tuple[Function, ...]:
    found = []
    for path, tree in _trees():
        for node in tree.body:
            inner = node.body if isinstance(node, ast.ClassDef) else [node]
            before = f"{node.name}." if isinstance(node, ast.ClassDef) else ""
            for each in inner:
                if isinstance(each, ast.FunctionDef):
                    kernel = any(_KERNEL.fullmatch(ast.unparse(d)) for d in each.decorator_list)
                    found.append(Function(path, before + each.name, _words(each), kernel))
    return tuple(found)
