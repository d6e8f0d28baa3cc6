"""Small mistakes in a source, found on its syntax tree and made in its text.

The operators are those of DeMillo, Lipton and Sayward (Hints on test data selection, IEEE Computer
11, 1978) as far as they are like what people get wrong here: a sign, an operator, a comparison, an
index, a term left out, a number, a statement left out.
"""

from __future__ import annotations

import ast
from dataclasses import dataclass

_ARITHMETIC = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.BitAnd: ("&", "|"),
    ast.BitOr: ("|", "&"),
}
_COMPARISONS = {
    ast.Lt: ("<", ">"),
    ast.Gt: (">", "<"),
    ast.LtE: ("<=", ">="),
    ast.GtE: (">=", "<="),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
}
_NAMES = {
    "min": "max",
    "max": "min",
    "minimum": "maximum",
    "maximum": "minimum",
    "argmin": "argmax",
    "argmax": "argmin",
    "sin": "cos",
    "cos": "sin",
    "any": "all",
    "all": "any",
}
_IDLE = (ast.Import, ast.ImportFrom, ast.Raise, ast.Assert, ast.JoinedStr)
_TEXTS = (ast.JoinedStr, ast.List, ast.Tuple)


@dataclass(frozen=True)
class Mutant:
    """A mistake: the bytes from ``start`` to ``end`` of a source become ``text``."""

    line: int
    what: str
    start: int
    end: int
    text: str

    def applied(self, source: str) -> str:
        """The source with the mistake, all else on its line: compiled code is found by it."""
        raw = source.encode()
        lines = "\n" * (raw[self.start : self.end].count(b"\n") - self.text.count("\n"))
        at = len(self.text) - self.text.endswith(")")
        text = self.text[:at] + lines + self.text[at:]
        return (raw[: self.start] + text.encode() + raw[self.end :]).decode()


def mutants_of(source: str) -> list[Mutant]:
    """Every mistake that the operators make in a source, in its order; few do not parse."""
    finder = _Finder(source)
    finder.visit(ast.parse(source))
    return sorted(set(finder.found), key=lambda m: (m.start, m.end, m.text))


def parses(source: str) -> bool:
    """Whether a source with a mistake is Python still."""
    try:
        ast.parse(source)
    except SyntaxError:
        return False
    return True


class _Finder(ast.NodeVisitor):
    """Goes through what is executed: no annotations, decorators, messages and assertions."""

    def __init__(self, source: str) -> None:
        self.raw = source.encode()
        self.lines = [0]
        for line in self.raw.splitlines(keepends=True):
            self.lines.append(self.lines[-1] + len(line))
        self.found: list[Mutant] = []

    def _span(self, node: ast.AST) -> tuple[int, int]:
        start = self.lines[node.lineno - 1] + node.col_offset  # type: ignore[attr-defined]
        end = self.lines[node.end_lineno - 1] + node.end_col_offset  # type: ignore[attr-defined]
        return start, end

    def _text(self, node: ast.AST) -> str:
        start, end = self._span(node)
        return self.raw[start:end].decode()

    def _add(self, node: ast.AST, what: str, start: int, end: int, text: str) -> None:
        before = " ".join(self.raw[start:end].decode().split())
        told = f"{what}: {before[:60]} -> {' '.join(text.split())[:60]}"
        self.found.append(Mutant(node.lineno, told, start, end, text))  # type: ignore[attr-defined]

    def _replace(self, node: ast.AST, what: str, text: str) -> None:
        self._add(node, what, *self._span(node), text)

    def _sign_between(
        self, node: ast.AST, left: ast.AST, right: ast.AST, old: str, new: str
    ) -> None:
        start, end = self._span(left)[1], self._span(right)[0]
        at = self.raw.find(old.encode(), start, end)
        if at >= 0:
            self._add(node, "operator", at, at + len(old), new)

    def visit(self, node: ast.AST) -> None:
        """Pass over what computes nothing: imports, failures and messages."""
        if not isinstance(node, _IDLE):
            super().visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        """The value alone."""
        if node.value is not None:
            self.visit(node.value)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        """The body and the defaults."""
        for default in (*node.args.defaults, *filter(None, node.args.kw_defaults)):
            self.visit(default)
        for statement in node.body:
            self.visit(statement)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        """The body."""
        for statement in node.body:
            self.visit(statement)

    def visit_Expr(self, node: ast.Expr) -> None:
        """A call for its effect may be left out; docstrings are none."""
        if isinstance(node.value, ast.Call):
            self._replace(node, "statement left out", "pass")
            self.visit(node.value)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        """Another operator, or the statement left out."""
        signs = _ARITHMETIC.get(type(node.op))
        if signs is not None:
            self._sign_between(node, node.target, node.value, f"{signs[0]}=", f"{signs[1]}=")
        self._replace(node, "statement left out", "pass")
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        """Another operator, or one of the two terms alone."""
        signs = _ARITHMETIC.get(type(node.op))
        sides = (node.left, node.right)
        texts = any(
            isinstance(s, _TEXTS) or (isinstance(s, ast.Constant) and isinstance(s.value, str))
            for s in sides
        )
        if signs is not None and not texts:
            self._sign_between(node, node.left, node.right, *signs)
            self._replace(node, "term left out", f"({self._text(node.left)})")
            if isinstance(node.op, ast.Add):
                self._replace(node, "term left out", f"({self._text(node.right)})")
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        """Without its sign, or its ``not``."""
        if isinstance(node.op, ast.USub | ast.Not | ast.Invert):
            self._replace(node, "sign", f"({self._text(node.operand)})")
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        """The other way round."""
        sides = [node.left, *node.comparators]
        for i, op in enumerate(node.ops):
            signs = _COMPARISONS.get(type(op))
            if signs is not None:
                self._sign_between(node, sides[i], sides[i + 1], *signs)
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        """``or`` in place of ``and``."""
        signs = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        self._sign_between(node, node.values[0], node.values[1], *signs)
        self.generic_visit(node)

    def visit_If(self, node: ast.If) -> None:
        """The other branch; what is for type checkers alone is left out."""
        if isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            return
        self._replace(node.test, "condition", f"(not ({self._text(node.test)}))")
        self.generic_visit(node)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        """Another index, or two of them swapped."""
        index = node.slice
        if isinstance(index, ast.Tuple) and len(index.elts) == 2:
            one, two = (self._text(each) for each in index.elts)
            if one != two and ":" not in one + two:
                self._replace(index, "indices", f"{two}, {one}")
        for each in index.elts if isinstance(index, ast.Tuple) else [index]:
            if isinstance(each, ast.Constant) and isinstance(each.value, int):
                self._replace(each, "index", str(each.value + 1))
            else:
                self.visit(each)
        self.visit(node.value)

    def visit_Call(self, node: ast.Call) -> None:
        """The sister of a function."""
        function = node.func
        name = getattr(function, "attr", getattr(function, "id", ""))
        if name in _NAMES:
            end = self._span(function)[1]
            self._add(node, "function", end - len(name), end, _NAMES[name])
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        """Another number or truth value."""
        if isinstance(node.value, bool):
            self._replace(node, "value", str(not node.value))
        elif isinstance(node.value, int):
            self._replace(node, "value", str(node.value + 1))
        elif isinstance(node.value, float):
            self._replace(node, "value", repr(2.0 * node.value if node.value else 1.0))
