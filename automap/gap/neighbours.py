"""The texts of formulas near one: every factor bent, one-sided, remembered or left out, the whole
times speed or above some speed alone, and amounts moved.
"""

from __future__ import annotations

import ast
import copy
import re
from collections.abc import Sequence

import numpy as np

from automap.effects.formula_text import parse_formula
from automap.effects.signals import Signals

Terms = tuple[tuple[str, str], ...]
"""Channel and text of each term of a formula."""
AMOUNT = re.compile(r"\d+(\.\d+)?e-?\d+|\d+\.\d+")
WIDER = 4.0
"""Factor by which that may be off what was tried: of a play of that width half is left."""
WIDTHS = 21
"""Steps of that: each is a seventh more than the one before, so that one of them is within 7 %."""
MEMORIES_S = (0.3, 1.0, 4.0, 16.0, 60.0)
"""Times for which something may be remembered: from a spring's to what warms through."""
BENDS = (0.3, 1.0, 3.0)
"""Sizes where a quantity may saturate, begin to count or stop to, over its root mean square: below
it is a sign, above it is a scale."""
SPEEDS = (25.0, 50.0, 75.0)
"""Percentiles of the speed of a drive above or below which a formula may act alone."""
INSTEAD = (
    ("force_x", "acceleration"),
    ("force_y", "lateral_acceleration"),
    ("lateral_acceleration", "rate_z"),
)
"""Quantities that are much the same in a vehicle."""
TURNS = {"gyro_x": "imu_roll", "gyro_y": "imu_pitch", "gyro_z": "imu_yaw"}
CHANGES = ("jerk_", "force_"), ("angular_acceleration_", "rate_")
"""A gyro that reads what a quantity changes by is much the same as a unit that turns by the
quantity, but that the accelerometer turns along."""
SHAPED = ("abs", "max", "min", "tanh", "sqrt")
FORMED = ("play(", "min(max(")
"""What a factor with another shape upon it has too many of: only its amounts are moved, as those of
a step. What is remembered has shapes, and no second memory."""


def neighbours(text: str, signals: Signals) -> list[str]:
    """The formulas near ``text`` on a drive of these signals, each once, without itself."""
    factors = _factors(parse_formula(text).tree)
    written = [_written(f) for f in factors]
    out = _with(written, [_forms(f, signals) for f in factors])
    if len(written) > 1:
        out += [_product([*written[:i], *written[i + 1 :]]) for i in range(len(written))]
    if "speed" not in written:
        out.append(_product([*written, "speed"]))
    if not any(w.startswith("step(") for w in written):
        for limit in np.percentile(signals.speed, SPEEDS):
            at = float(f"{limit:.2g}")
            if at > 0.0:
                ends = (f"speed - {at}", f"{at} - speed")
                out += [_product([*written, f"step({end})"]) for end in ends]
    for pair in INSTEAD:
        for old, new in (pair, pair[::-1]):
            out.append(re.sub(rf"\b{old}\b", new, text))
    return _others(out, text)


def as_turn(on: str, text: str) -> Terms:
    """What the unit, or the vehicle, turns by where its gyro reads the changes of that; nothing
    where it reads something else."""
    changes = [(change, of) for change, of in CHANGES if change in text]
    if on not in TURNS or len(changes) != 1:
        return ()
    return ((TURNS[on], text.replace(*changes[0])),)


def complexity(terms: Terms) -> tuple[int, int]:
    """How many numbers a formula has, coefficients and amounts, and of how many parts it is."""
    texts = [text for _, text in terms]
    parts = sum(1 for text in texts for _ in ast.walk(parse_formula(text).tree))
    return sum(1 + len(AMOUNT.findall(text)) for text in texts), parts


def amounts(text: str) -> list[str]:
    """The formulas that have one amount of ``text`` moved: how long it remembers, where it bends.
    Whole numbers are none: they count."""
    written = [_written(f) for f in _factors(parse_formula(text).tree)]
    texts = dict.fromkeys(_with(written, [_moved(w) for w in written]))
    return [t for t in texts if t != _product(written)]


def _with(written: Sequence[str], forms: Sequence[Sequence[str]]) -> list[str]:
    """The product with each of the forms of a factor in its place."""
    return [
        _product([*written[:i], new, *written[i + 1 :]])
        for i, its in enumerate(forms)
        for new in its
    ]


def _others(texts: Sequence[str], text: str) -> list[str]:
    """Each once, without ``text`` however it is written."""
    same = ast.dump(parse_formula(text).tree)
    return [t for t in dict.fromkeys(texts) if ast.dump(parse_formula(t).tree) != same]


def _forms(factor: ast.expr, signals: Signals) -> list[str]:
    """Other forms of one factor: shapes of what stands in it, memories of it."""
    text = _written(factor)
    formed = text.startswith("step(") or any(word in text for word in FORMED)
    if formed or isinstance(factor, ast.Constant):
        return []
    inner = _written(_inner(factor))
    value = parse_formula(inner)(signals)
    size = float(np.sqrt(np.mean(value**2)))
    if not 0.0 < size < np.inf:
        return []
    sizes = [float(f"{b * size:.2g}") for b in BENDS]
    out = [inner, f"{inner}^2", f"{inner}^3", *(f"tanh({inner} / {a})" for a in sizes)]
    if value.min() < 0.0 < value.max():
        out += [
            f"abs({inner})",
            f"({inner} * abs({inner}))",
            f"max({inner}, 0)",
            f"min({inner}, 0)",
        ]
        for a in sizes[:2]:
            out += [f"({inner} - min(max({inner}, -{a}), {a}))", f"max(abs({inner}) - {a}, 0)"]
            out += [f"max({inner} - {a}, 0)", f"min({inner} + {a}, 0)"]
    elif value.min() >= 0.0:
        out += [f"sqrt({inner})", *(f"(1 / max({inner}, {a}))" for a in sizes)]
        for a in sizes:
            # above is what below is not
            out += [f"max({inner} - {a}, 0)", f"max({a} - {inner}, 0)", f"step({a} - {inner})"]
    if "lag(" not in text:
        memories = [(text, f"{t}") for t in MEMORIES_S]
        if text != inner:
            # a shape of what is remembered is another thing than the memory of a shape
            out += [_with_instead(factor, inner, f"lag({inner}, {t})") for t in MEMORIES_S]
    else:
        memories = _memory(factor)
        out += [what for what, _ in memories]
    out += [f"lag({what}, {t})" for what, t in memories]
    return out + [f"({what} - lag({what}, {t}))" for what, t in memories]


def _memory(factor: ast.expr) -> list[tuple[str, str]]:
    """What a factor remembers, or has left beside what it remembers, and how long; nothing where it
    is something else."""
    call = factor.right if isinstance(factor, ast.BinOp) else factor
    if isinstance(call, ast.Call) and ast.unparse(call.func) == "lag":
        return [(_written(call.args[0]), _written(call.args[1]))]
    return []


def _moved(factor: str) -> list[str]:
    """A factor as it is written with one of its amounts moved, wherever it has that."""
    out = []
    for amount in sorted({m.group() for m in AMOUNT.finditer(factor)}, key=float):
        moved = float(amount) * np.geomspace(1.0 / WIDER, WIDER, WIDTHS)
        own = rf"(?<![\w.]){re.escape(amount)}(?![\w.])"
        out += [re.sub(own, f"{float(f'{v:.3g}')}", factor) for v in moved.tolist() if v > 0.0]
    return out


def _with_instead(factor: ast.expr, old: str, new: str) -> str:
    """A factor with something ``new`` wherever it has something ``old``."""
    was, instead = parse_formula(old).tree, parse_formula(new).tree
    changed = _Instead(ast.dump(was), instead).visit(copy.deepcopy(factor))
    assert isinstance(changed, ast.expr)
    return _written(changed)


class _Instead(ast.NodeTransformer):
    """One part of a formula, as it is dumped, in the place of another."""

    def __init__(self, old: str, new: ast.expr) -> None:
        self.old, self.new = old, new

    def visit(self, node: ast.AST) -> ast.AST:
        if ast.dump(node) == self.old:
            return copy.deepcopy(self.new)
        return super().generic_visit(node)


def _inner(factor: ast.expr) -> ast.expr:
    """What a shape is made of: its argument, the base of a power, else the factor itself."""
    if isinstance(factor, ast.BinOp) and isinstance(factor.op, ast.Pow):
        return factor.left
    if isinstance(factor, ast.BinOp) and isinstance(factor.left, ast.Constant):
        return _inner(factor.right)
    if isinstance(factor, ast.Call) and isinstance(factor.func, ast.Name):
        if factor.func.id not in SHAPED:
            return factor
        argument = factor.args[0]
        if isinstance(argument, ast.BinOp) and isinstance(argument.right, ast.Constant):
            return argument.left
        if isinstance(argument, ast.BinOp) and isinstance(argument.left, ast.Constant):
            return argument.right
        return argument
    return factor


def _factors(tree: ast.expr) -> list[ast.expr]:
    if isinstance(tree, ast.BinOp) and isinstance(tree.op, ast.Mult):
        return [*_factors(tree.left), *_factors(tree.right)]
    return [tree]


def _product(factors: Sequence[str]) -> str:
    return " * ".join(factors)


def _written(tree: ast.expr) -> str:
    """A factor as text, in brackets where it needs them."""
    text = ast.unparse(tree).replace(" ** ", "^")
    power = isinstance(tree, ast.BinOp) and isinstance(tree.op, ast.Pow)
    return f"({text})" if isinstance(tree, ast.BinOp | ast.UnaryOp) and not power else text
