"""Formulas as text: ``sin(heading) * speed^2`` becomes a function of a drive's quantities.

Python's own grammar without anything but numbers, names of quantities, the four operations,
powers and a few functions; nothing else can be called, so a formula cannot do harm.
"""

from __future__ import annotations

import ast
import difflib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from automap.effects.memory_kernels import lag, play
from automap.effects.signals import VOCABULARY, Signals
from automap.errors import ConfigError
from automap.records import FloatArray

_OPERATIONS: dict[type[ast.AST], Callable[[Any, Any], Any]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
}


def _step(x: FloatArray) -> FloatArray:
    return np.asarray(np.asarray(x) > 0.0, np.float64)


FUNCTIONS: Mapping[str, tuple[Callable[..., Any], int]] = {
    "sin": (np.sin, 1),
    "cos": (np.cos, 1),
    "tan": (np.tan, 1),
    "tanh": (np.tanh, 1),
    "exp": (np.exp, 1),
    "log": (np.log, 1),
    "sqrt": (np.sqrt, 1),
    "abs": (np.abs, 1),
    "sign": (np.sign, 1),
    "step": (_step, 1),
    "max": (np.maximum, 2),
    "min": (np.minimum, 2),
}
"""Functions with their number of arguments; ``step`` is one above zero, else zero."""
REMEMBERING = ("lag", "play")
"""Functions of what has been: ``lag(x, s)`` follows x in s seconds, ``play(x, w)`` hangs behind it
by w. Their second argument is a number."""
KNOWN = (*FUNCTIONS, *REMEMBERING)


@dataclass(frozen=True)
class FormulaText:
    """A formula that was read; called with signals it gives its value [n]."""

    text: str
    tree: ast.expr

    def __call__(self, signals: Signals) -> FloatArray:
        """Value [n] at the instants of the signals."""
        with np.errstate(all="ignore"):
            value = np.asarray(_value(self.tree, signals), np.float64)
        return np.array(np.broadcast_to(value, signals.time.shape))


@lru_cache(maxsize=4096)
def parse_formula(text: str) -> FormulaText:
    """Read a formula.

    Raises:
        ConfigError: it is not understood; the message says which part.
    """
    try:
        # a caret is a power to most people
        tree = ast.parse(text.replace("^", "**"), mode="eval").body
    except (SyntaxError, ValueError):
        raise ConfigError(
            f"the formula '{text}' is not understood; write it like 'sin(heading) * speed^2'"
        ) from None
    _check(tree, text)
    return FormulaText(text, tree)


def _check(node: ast.expr, text: str) -> None:
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATIONS:
        _check(node.left, text)
        _check(node.right, text)
        return
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
        _check(node.operand, text)
        return
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return
    if isinstance(node, ast.Name):
        if node.id == "pi" or node.id in VOCABULARY:
            return
        raise ConfigError(
            f"the formula '{text}' has '{node.id}', which is no quantity of a drive; "
            + _hint(node.id, VOCABULARY)
        )
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        name = node.func.id
        if name not in KNOWN:
            raise ConfigError(
                f"the formula '{text}' has the function '{name}'; " + _hint(name, KNOWN)
            )
        wanted = FUNCTIONS[name][1] if name in FUNCTIONS else 2
        if len(node.args) != wanted:
            raise ConfigError(f"the formula '{text}' gives {name}() {len(node.args)} of {wanted}")
        for argument in node.args:
            _check(argument, text)
        if name in REMEMBERING and not _is_amount(node.args[1]):
            raise ConfigError(
                f"the formula '{text}' gives {name}() '{ast.unparse(node.args[1])}' where a number "
                "above 0 is wanted"
            )
        return
    raise ConfigError(
        f"the formula '{text}' has '{ast.unparse(node)}', which is not understood; numbers, "
        "quantities, + - * / ^ and functions are"
    )


def _is_amount(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and 0.0 < float(str(node.value)) < math.inf


def _hint(word: str, known: tuple[str, ...]) -> str:
    near = difflib.get_close_matches(word, known, n=1)
    return f"did you mean '{near[0]}'?" if near else "there are " + ", ".join(known)


def _value(node: ast.expr, signals: Signals) -> Any:
    if isinstance(node, ast.BinOp):
        left, right = _value(node.left, signals), _value(node.right, signals)
        return _OPERATIONS[type(node.op)](left, right)
    if isinstance(node, ast.UnaryOp):
        inner = _value(node.operand, signals)
        return -inner if isinstance(node.op, ast.USub) else inner
    if isinstance(node, ast.Constant):
        return float(str(node.value))
    if isinstance(node, ast.Name):
        return np.pi if node.id == "pi" else getattr(signals, node.id)
    assert isinstance(node, ast.Call)
    assert isinstance(node.func, ast.Name)
    arguments = [_value(a, signals) for a in node.args]
    if node.func.id in REMEMBERING:
        of = np.array(np.broadcast_to(arguments[0], signals.time.shape), np.float64)
        if node.func.id == "lag":
            return lag(of, np.ascontiguousarray(signals.time), arguments[1])
        return play(of, arguments[1])
    return FUNCTIONS[node.func.id][0](*arguments)
