"""What a finder's formulas say, evaluated on a drawn drive.

A formula of ``gap.json`` names an axis, a function of the drive's quantities, and a coefficient;
quantities and functions are those of the manual. They are computed here from the true motion.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter1d

from tests.hidden_effects.extras import Extras
from tests.hidden_effects.geodesy import Array
from tests.hidden_effects.imu import Signals
from tests.hidden_effects.motion import Motion, State
from tests.hidden_effects.outside import antenna, lagged, to_north

FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "tanh": np.tanh,
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "sign": np.sign,
    "step": lambda x: np.asarray(x > 0.0, np.float64),
    "max": np.maximum,
    "min": np.minimum,
}
_OPERATORS: Mapping[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
}
IMU_AXES = tuple(f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz")
FIX_AXES = (
    "position_along",
    "position_across",
    "height",
    "velocity_along",
    "velocity_across",
    "velocity_down",
)
VEHICLE_AXES = ("nhc_y", "nhc_z")
ANTENNA_AXES = ("antenna_x", "antenna_y", "antenna_z")
MOUNT_AXES = ("imu_roll", "imu_pitch", "imu_yaw")


@dataclass(frozen=True)
class Term:
    """``channel`` += ``coefficient`` times ``formula``."""

    channel: str
    formula: str
    coefficient: float


def terms_of(unexplained: Mapping[str, Any] | None) -> tuple[Term, ...]:
    """The terms that an answer's ``unexplained`` states."""
    if unexplained is None:
        return ()
    rows: Sequence[Mapping[str, Any]] = unexplained.get("terms") or ()
    return tuple(Term(str(r["channel"]), str(r["formula"]), float(r["coefficient"])) for r in rows)


def evaluate(text: str, quantities: Mapping[str, Array]) -> Array:
    """A formula of ``quantities`` [n].

    Raises:
        ValueError: what is no formula of the manual.
    """

    def value(node: ast.expr) -> Any:
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
            return float(node.value)
        if isinstance(node, ast.Name) and node.id in quantities:
            return quantities[node.id]
        if isinstance(node, ast.Name) and node.id == "pi":
            return np.pi
        if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
            return _OPERATORS[type(node.op)](value(node.left), value(node.right))
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.UAdd):
            return -value(node.operand) if isinstance(node.op, ast.USub) else value(node.operand)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
            if node.func.id in ("lag", "play"):
                of = np.broadcast_to(value(node.args[0]), (size,))
                amount = float(value(node.args[1]))
                return (
                    _late(of, quantities["time"], amount)
                    if node.func.id == "lag"
                    else _hung(of, amount)
                )
            function = FUNCTIONS.get(node.func.id)
            if function is not None:
                return function(*[value(a) for a in node.args])
        raise ValueError(f"no formula: {text}")

    try:
        tree = ast.parse(text.replace("^", "**"), mode="eval")
    except SyntaxError as error:
        raise ValueError(f"no formula: {text}") from error
    size = len(next(iter(quantities.values())))
    with np.errstate(all="ignore"):
        out = np.broadcast_to(np.asarray(value(tree.body), np.float64), (size,))
    return np.nan_to_num(out)


def _late(values: Array, t: Array, seconds: float) -> Array:
    """A first-order low-pass of values [n], at rest where they begin."""
    fine = np.arange(t[0], t[-1] + 0.01, 0.01)
    moved = lagged(np.interp(fine, t, values), seconds, 0.01)
    return np.asarray(np.interp(t, fine, moved))


def _hung(values: Array, width: float) -> Array:
    """What a joint with a play passes on of values [n]."""
    out, at = np.empty(len(values)), 0.0
    for i, value in enumerate(np.asarray(values).tolist()):
        at = min(max(at, value - width), value + width)
        out[i] = at
    return out


def _of_signals(s: Signals) -> dict[str, Array]:
    return {
        "time": s.t,
        "speed": s.state.speed,
        "heading": s.state.rpy[:, 2],
        "acceleration": s.state.accel,
        "lateral_acceleration": s.state.speed * s.state.rate_nav[:, 2],
        **{f"rate_{axis}": s.rate[:, i] for i, axis in enumerate("xyz")},
        **{f"force_{axis}": s.force[:, i] for i, axis in enumerate("xyz")},
        **{f"angular_acceleration_{a}": _change(s.rate[:, i], s.t) for i, a in enumerate("xyz")},
        **{f"jerk_{a}": _change(s.force[:, i], s.t) for i, a in enumerate("xyz")},
        "rate": np.linalg.norm(s.rate, axis=1),
        "force": np.linalg.norm(s.force, axis=1),
        "climb": -s.state.vel_ned[:, 2],
        "temperature": s.temp_c,
        "temperature_rate": np.gradient(s.temp_c, s.t),
    }


def _change(values: Array, t: Array) -> Array:
    """Slope a second of the average over a Gaussian of 50 ms, as the manual has it."""
    if len(t) < 2:
        return np.zeros_like(values)
    step = max(float(np.median(np.diff(t))), 0.005)
    return np.asarray(np.gradient(gaussian_filter1d(values, 0.05 / step), t))


def _of_motion(motion: Motion, t: Array) -> dict[str, Array]:
    """The same at fixes; the temperature is not known there."""
    return _of_state(motion.at(t))


def _of_state(state: State) -> dict[str, Array]:
    none = np.zeros_like(state.t)
    return _of_signals(Signals(state.t, state.force, state.rate, none, state)) | {
        "temperature_rate": none
    }


def told_extras(terms: Sequence[Term]) -> Extras:
    """The terms as errors of a recording.

    Raises:
        ValueError: on use, of what is no formula of the manual.
    """
    inertial = [t for t in terms if t.channel in IMU_AXES]
    measured = [t for t in terms if t.channel in (*FIX_AXES, *ANTENNA_AXES)]
    vehicle = [t for t in terms if t.channel in VEHICLE_AXES]
    mounted = [t for t in terms if t.channel in MOUNT_AXES]
    stamps = [t for t in terms if t.channel == "imu_time"]

    def imu(s: Signals) -> tuple[Array, Array]:
        out = np.zeros_like(s.rate), np.zeros_like(s.force)
        known = _of_signals(s)
        for term in inertial:
            target = out[term.channel[0] == "a"]
            target[:, "xyz".index(term.channel[-1])] += term.coefficient * evaluate(
                term.formula, known
            )
        turn = np.zeros_like(s.rate)
        for term in mounted:
            angle = term.coefficient * evaluate(term.formula, known)
            turn[:, MOUNT_AXES.index(term.channel)] += angle
        swing = np.gradient(turn, s.t, axis=0)
        return out[0] + np.cross(s.rate, turn) + swing, out[1] + np.cross(s.force, turn)

    def clock(t: Array) -> Array:
        return sum((c.coefficient * evaluate(c.formula, {"time": t}) for c in stamps), 0.0 * t)

    def fix(motion: Motion, t: Array) -> tuple[Array, Array]:
        known = _of_motion(motion, t)
        sums = {axis: np.zeros_like(t) for axis in FIX_AXES}
        for term in measured:
            if term.channel in sums:
                sums[term.channel] += term.coefficient * evaluate(term.formula, known)
        place = (sums["position_along"], sums["position_across"], -sums["height"])
        speed = (sums["velocity_along"], sums["velocity_across"], sums["velocity_down"])
        moved = antenna(arm)(1.0).fix
        assert moved is not None
        further, faster = moved(motion, t)
        return to_north(motion, t, *place) + further, to_north(motion, t, *speed) + faster

    def arm(state: State, step_s: float) -> Array:
        out, known = np.zeros((len(state.t), 3)), _of_state(state)
        for term in measured:
            if term.channel in ANTENNA_AXES:
                amount = term.coefficient * evaluate(term.formula, known)
                out[:, ANTENNA_AXES.index(term.channel)] += amount
        return out

    def nhc(motion: Motion, t: Array) -> Array:
        known = _of_motion(motion, t)
        out = np.zeros((len(t), 2))
        for term in vehicle:
            out[:, VEHICLE_AXES.index(term.channel)] -= term.coefficient * evaluate(
                term.formula, known
            )
        return out

    return Extras(
        imu=imu if inertial or mounted else None,
        clock=clock if stamps else None,
        fix=fix if measured else None,
        nhc=nhc if vehicle else None,
    )
