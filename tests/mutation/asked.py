"""Which tests are asked of a mistake: those that call what it is in, the quickest first.

Kernels are interpreted: nothing is compiled for a mistake, and every call is seen. Tests that take
too long so, of whole drives, are not asked; what share is noticed is rather too small for it. Only
tests of what holds no kernel (``COMPILED``) run a whole drive, with kernels compiled once.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from tests.mutation.areas import PROJECT

LIMIT_S = 10.0
"""Tests that take longer, interpreted, are not asked."""

COMPILED = ("tests/unit/test_cache_inputs.py",)
"""Test files that take a whole drive, which needs compiled kernels."""

_COMPILED_LIMIT_S = 300.0
"""The same of these: the first compiles every kernel."""


@dataclass(frozen=True)
class Asked:
    """A test, and what it takes as the code is."""

    test: str
    seconds: float
    shared: tuple[tuple[str, float], ...] = ()
    """the fixtures that it shares with others, and their seconds"""

    @property
    def order(self) -> tuple[float, str, float]:
        """The quickest first; those that share a dear fixture beside each other."""
        dear = sum(seconds for _, seconds in self.shared if seconds > _DEAR_S)
        return dear, self.test.split("::")[0] if dear else "", self.seconds


_DEAR_S = 0.1


class Calls:
    """What each test calls, kept in a file and brought up to date."""

    def __init__(self, path: Path) -> None:
        self.path = path
        kept: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
        self.of: dict[str, dict[str, Any]] = kept

    def record(self, files: Sequence[str], root: Path, variables: dict[str, str]) -> None:
        """Run those of some test files that are new or edited, and keep what they call."""
        digests = {f: hashlib.sha256((root / f).read_bytes()).hexdigest() for f in files}
        new = [f for f in files if self.of.get(f, {}).get("digest") != digests[f]]
        for name in new:
            told = self.path.with_suffix(".told")
            more = {"AUTOMAP_CALLS": str(told), "AUTOMAP_CALLS_LIMIT": str(LIMIT_S)}
            if name in COMPILED:
                more |= {"AUTOMAP_CALLS_LIMIT": str(_COMPILED_LIMIT_S), "NUMBA_DISABLE_JIT": "0"}
            command = [sys.executable, "-m", "pytest", "-q", "-p", "tests.mutation.calls"]
            command += ["-p", "no:cacheprovider", "-p", "no:xdist", name]
            told.unlink(missing_ok=True)
            subprocess.run(
                command,
                cwd=root,
                env=os.environ | variables | more,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                check=False,
            )
            tests = json.loads(told.read_text()) if told.exists() else {}
            print(f"{name}: {len(tests)} tests", file=sys.stderr, flush=True)
            self.of[name] = {"digest": digests[name], "tests": tests}
            self.path.write_text(json.dumps(self.of))

    def tests_of(
        self, names: set[str], seconds: float, only: Sequence[str] = (), compiled: bool = False
    ) -> list[Asked]:
        """The tests that call one of some functions, as many as ``seconds`` allow."""
        found = [
            Asked(test, told["seconds"], tuple(sorted(told["shared"].items())))
            for file, of in self.of.items()
            if (not only or file in only) and (compiled or file not in COMPILED)
            for test, told in of["tests"].items()
            if not names.isdisjoint(told["calls"])
        ]
        chosen: list[Asked] = []
        there: dict[str, float] = {}
        for each in sorted(found, key=lambda a: a.order):
            more = there | dict(each.shared)
            if sum(more.values()) + sum(c.seconds for c in [*chosen, each]) <= seconds:
                there = more
                chosen.append(each)
        return chosen


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
    return {function for function, used in _uses() if not words.isdisjoint(used)}


def _place(source: Path, line: int) -> tuple[str, set[str]]:
    node: Any = next(tree for path, tree in _trees() if path == str(source))
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
    paths = [p for name in ("automap", "pipeline") for p in (PROJECT / name).rglob("*.py")]
    return [(str(p.relative_to(PROJECT)), ast.parse(p.read_text())) for p in paths]


def _words(node: ast.AST) -> frozenset[str]:
    found = {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
    return frozenset(found | {n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute)})


@cache
def _constants() -> list[tuple[str, frozenset[str]]]:
    return [
        (name, _words(node.value))
        for _, tree in _trees()
        for node in tree.body
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
        for name in re.findall(r"\w+", ast.unparse(target))
    ]


@cache
def _uses() -> list[tuple[str, frozenset[str]]]:
    found = []
    for path, tree in _trees():
        for node in tree.body:
            inner = node.body if isinstance(node, ast.ClassDef) else [node]
            before = f"{node.name}." if isinstance(node, ast.ClassDef) else ""
            found += [
                (f"{path}:{before}{n.name}", _words(n))
                for n in inner
                if isinstance(n, ast.FunctionDef)
            ]
    return found
