"""What the sources say of themselves, read without importing them."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path


def import_statements(tree: ast.AST) -> Iterator[ast.Import | ast.ImportFrom]:
    """Each import, wherever it stands: at the top, inside a function, for the type checker.

    Only statements hold statements: expressions, nine tenths of a tree, are not gone through.
    """
    for name in ("body", "orelse", "finalbody", "handlers", "cases"):
        for node in getattr(tree, name, ()):
            if isinstance(node, ast.Import | ast.ImportFrom):
                yield node
            else:
                yield from import_statements(node)


def imports_of(path: Path) -> list[tuple[int, str, str | None]]:
    """Line, module and name (None for ``import module``) of all that the file imports."""
    found: list[tuple[int, str, str | None]] = []
    for node in import_statements(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name, None) for alias in node.names]
        else:
            assert not node.level, f"{path}:{node.lineno}: a relative import"
            assert node.module
            found += [(node.lineno, node.module, alias.name) for alias in node.names]
    return found
