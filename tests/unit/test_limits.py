"""Numbers that decide a result: each is used, and says why it is what it is."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LIMITS = sorted(
    path.relative_to(ROOT)
    for top in ("automap", "pipeline")
    for path in (ROOT / top).rglob("limits.py")
)
JUDGE = (
    "fusion",
    "sync",
    "calibration",
    "vision",
    "geolocation",
    "mapping",
    "review",
    "evaluation",
    "regression",
)
"""Packages whose numbers stand in their ``limits``; codes, sizes and steps of an algorithm stand
where they are used, and say so."""


def _names(statement: ast.Assign) -> list[str]:
    target = statement.targets[0]
    parts = target.elts if isinstance(target, ast.Tuple) else [target]
    return [part.id for part in parts if isinstance(part, ast.Name)]


def _explained(body: list[ast.stmt], place: int) -> bool:
    """Whether a text follows a statement."""
    below = body[place + 1 : place + 2]
    return (
        bool(below) and isinstance(below[0], ast.Expr) and isinstance(below[0].value, ast.Constant)
    )


@cache
def _names_used(top: str) -> set[str]:
    return {
        node.attr if isinstance(node, ast.Attribute) else node.id
        for file in (ROOT / top).rglob("*.py")
        for node in ast.walk(ast.parse(file.read_bytes()))
        if isinstance(node, ast.Attribute | ast.Name) and isinstance(node.ctx, ast.Load)
    }


@pytest.mark.parametrize("path", LIMITS, ids=str)
def test_every_limit_has_its_reason_and_is_used(path: Path) -> None:
    body = ast.parse((ROOT / path).read_text()).body
    limits = [(i, s) for i, s in enumerate(body) if isinstance(s, ast.Assign)]
    assert limits
    assert [_names(s) for i, s in limits if not _explained(body, i)] == []
    used = _names_used("pipeline") | _names_used(path.parts[0])
    assert {name for _, s in limits for name in _names(s)} - used == set()


def _is_decimal(value: ast.expr) -> bool:
    if isinstance(value, ast.UnaryOp):
        return _is_decimal(value.operand)
    return isinstance(value, ast.Constant) and isinstance(value.value, float)


@pytest.mark.parametrize("package", JUDGE)
def test_no_decimal_of_a_package_goes_without_a_reason(package: str) -> None:
    bare = []
    for path in sorted((ROOT / "automap" / package).rglob("*.py")):
        text = path.read_text()
        body = ast.parse(text).body
        for i, statement in enumerate(body):
            if isinstance(statement, ast.Assign) and _is_decimal(statement.value):
                above = text.splitlines()[statement.lineno - 2].strip()
                if not (_explained(body, i) or above.startswith("#")):
                    bare.append(f"{path.relative_to(ROOT)}:{statement.lineno}: {_names(statement)}")
    assert bare == []
