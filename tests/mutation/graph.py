"""Which functions a line of a source may change, and which kernels and tests come to them.

All is read in the sources: a function is taken to call what it names, if its file imports the file
in which that is defined, or another that hands it on. Too many are found rather than too few.
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from tests.mutation.areas import PROJECT, imported

DEPTH = 9
"""Calls between a test and what it notices, at most."""

_KERNEL = re.compile(r"kernel|kernel_with\(.*\)", re.DOTALL)
_TEST = re.compile(r"tests/unit/test_\w+\.py:(?:Test\w+\.)?test_\w+")
_FIGURES = "tests/unit/test_figures.py::test_figures_are_those_that_were_kept"


class Function(NamedTuple):
    """A function or a constant of the project, the words in it, and what it is.

    It may be compiled, or be a scenario, which is asked by the test of figures.
    """

    path: str
    name: str
    words: frozenset[str]
    kernel: bool
    scenario: bool = False

    def __str__(self) -> str:
        return f"{self.path}:{self.name}"

    @property
    def called(self) -> str:
        """The word by which it is called: a method by its own name, what python calls itself by
        that of the class."""
        first, _, last = self.name.rpartition(".")
        return first if last.startswith("__") and first else last


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
        words |= {c.name for c in _constants() if not words.isdisjoint(c.words)}
    return {str(f) for f in _functions() if not words.isdisjoint(f.words)}


def kernels_from(changed: set[str]) -> set[str]:
    """Of changed functions the kernels, and all kernels that these are compiled into."""
    found = {f for f in _functions() if f.kernel and str(f) in changed}
    while True:
        more = {f for f in _naming(found) if f.kernel} - found
        if not more:
            return {str(f) for f in found}
        found |= more


def reaching(changed: set[str]) -> dict[str, int]:
    """The tests that may come to one of some functions, and by how many calls at least."""
    found = {f: 0 for f in _functions() if str(f) in changed}
    last = set(found)
    for depth in range(1, DEPTH + 1):
        last = _naming(last) - found.keys()
        found |= dict.fromkeys(last, depth)
    tests = {str(f): depth for f, depth in found.items() if _TEST.fullmatch(str(f))}
    named = {name.replace(":", "::").replace(".Test", "::Test"): d for name, d in tests.items()}
    kept = {str(f): depth for f, depth in found.items() if f.scenario}
    return named | {f"{_FIGURES}[{name.split(':')[1]}]": d for name, d in kept.items()}


def _naming(called: set[Function]) -> set[Function]:
    return {
        each
        for one in called
        for each in _by_word()[one.called]
        if one.path in _origins(each.path, one.called, "." in one.name)
    }


@cache
def _origins(path: str, word: str, method: bool) -> frozenset[str]:
    """The files in which a word that a source uses may be defined."""
    direct = {path} | {str(i) for i in imported(PROJECT, Path(path))}
    if method:  # of an object that others made
        return frozenset(direct | {j for i in direct for j in _all_imported(i)})
    # a front hands on what others define
    fronts = {str(i) for each in direct if word in _handed_on(each) for i in _imports_of(each)}
    return frozenset(direct | fronts)


@cache
def _imports_of(path: str) -> frozenset[str]:
    return frozenset(str(i) for i in imported(PROJECT, Path(path)))


@cache
def _all_imported(path: str) -> frozenset[str]:
    found: set[str] = set()
    waiting = {path}
    while waiting:
        each = waiting.pop()
        found.add(each)
        waiting |= _imports_of(each) - found
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
def _trees() -> tuple[tuple[str, ast.Module], ...]:
    places = [PROJECT / name for name in ("automap", "pipeline", "tests/unit")]
    paths = [*(p for place in places for p in place.rglob("*.py")), PROJECT / "tests/conftest.py"]
    return tuple((str(p.relative_to(PROJECT)), ast.parse(p.read_text())) for p in paths)


def _words(node: ast.AST) -> frozenset[str]:
    # arguments are named too: fixtures
    kinds = ("id", "attr", "arg")
    named = (getattr(n, kind, None) for n in ast.walk(node) for kind in kinds)
    return frozenset(word for word in named if isinstance(word, str))


@cache
def _constants() -> tuple[Function, ...]:
    return tuple(
        Function(path, name, _words(node.value), False)
        for path, tree in _trees()
        if not path.startswith("tests")
        for node in tree.body
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
        for name in re.findall(r"\w+", ast.unparse(target))
    )


@cache
def _functions() -> tuple[Function, ...]:
    found = []
    for path, tree in _trees():
        for node in tree.body:
            inner = node.body if isinstance(node, ast.ClassDef) else [node]
            before = f"{node.name}." if isinstance(node, ast.ClassDef) else ""
            for each in inner:
                if isinstance(each, ast.FunctionDef):
                    marks = [ast.unparse(d) for d in each.decorator_list]
                    kernel = any(_KERNEL.fullmatch(mark) for mark in marks)
                    name, kept = before + each.name, "scenario" in marks
                    found.append(Function(path, name, _words(each), kernel, kept))
    return tuple(found)


@cache
def _by_word() -> dict[str, list[Function]]:
    found = defaultdict(list)
    for function in (*_functions(), *_constants()):
        for word in function.words:
            found[word].append(function)
    return found
