"""Formulas and rivals of an answer as text: which quantities they name, and on which axis."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

_TERMS = {
    "force_x": r"f_?x|force_?x|accel_?x|a_?x|acceler|braking",
    "force_y": r"f_?y|force_?y|accel_?y|lateral|a_?y",
    "rate_z": r"omega_?z|w_?z|rate_?z|gyro_?z|yaw.?rate|ω_?z",
    "rate": r"omega|rate|gyro|ω",
    "speed": r"speed|(?<![a-z])v(?![a-z])",
    "heading": r"heading|yaw|psi|course",
    "time": r"(?<![a-z])t(?![a-z])|time|warm|ramp|step",
    "sign": r"sign|tanh|sgn|hyster",
    "half": r"max|abs|\||positive|negative|half|one.?sided",
    "sine": r"sin",
    "square": r"\^\s*2|\*\*\s*2|²|squar|abs|\|",
    "cube": r"\^\s*3|\*\*\s*3|³|cub",
    "step": r"step|>|heaviside",
}
_RIGHT: dict[str, tuple[str, tuple[str, ...]]] = {
    "heading_sine": ("accel_x", ("heading", "sine")),
    "rate_squared": ("gyro_x", ("rate", "square")),
    "force_times_rate": ("accel_z", ("force_x", "rate_z")),
    "speed_cubed": ("accel_x", ("speed", "cube")),
    "warm_up": ("gyro_z", ("time",)),
    "one_sided": ("accel_y", ("force_x", "half")),
    "speed_times_lateral": ("accel_x", ("speed", "force_y")),
    "step": ("accel_y", ("step",)),
    "position_speed_squared": ("position", ("speed", "square")),
    "hysteresis": ("accel_z", ("sign",)),
}


def formula_is_right(kind: str, told: Mapping[str, Any]) -> bool:
    """Whether a reported formula has the channel and the factors of the hidden one."""
    channel, terms = _RIGHT[kind]
    text = str(told["formula"]).lower()
    place = f"{told['channel']} {text}".lower()
    right_place = channel in place or channel.replace("_", " ") in place
    return right_place and all(re.search(_TERMS[term], text) for term in terms)


def told_beside_a_name(kind: str, shown: Sequence[Mapping[str, Any]]) -> bool:
    """Whether the right formula is told as what a name cannot be told from."""
    confusable = (str(r) for f in shown for r in f.get("confusable_with", ()) if "+=" in str(r))
    return any(
        formula_is_right(kind, {"channel": r.partition(" ")[0], "formula": r}) for r in confusable
    )


def terms_told_beside(
    effects: Mapping[str, Mapping[str, float]], shown: Sequence[Mapping[str, Any]]
) -> bool:
    """Whether what a name cannot be told from is a formula of the hidden effect's terms alone."""
    true = {term for effect in effects for term in _terms_of(effect, effects[effect])}
    for finding in shown:
        for rival in map(str, finding.get("confusable_with", ())):
            terms = {(c, q) for c, q in re.findall(r"(\w+) \+= k\d* \* ([^;]+)", rival)}
            if terms and terms <= true:
                return True
    return False


def _terms_of(effect: str, values: Mapping[str, float]) -> set[tuple[str, str]]:
    """What an effect of the sensors adds, as (axis, quantity)."""
    sensor, _, kind = effect.partition("_")
    quantity = {"accel": "force", "gyro": "rate"}.get(sensor, "")
    out = set()
    for p in values:
        where = f"{sensor}_{p[0]}"
        if kind in ("misalignment", "g_sensitivity") and len(p) == 2:
            out.add((where, f"{'force' if kind == 'g_sensitivity' else quantity}_{p[1]}"))
        elif kind == "scale_asymmetry":
            same = (f"abs({quantity}_{p})", f"max({quantity}_{p}, 0)", f"min({quantity}_{p}, 0)")
            out |= {(where, text) for text in same}
        elif kind == "quadratic":
            out.add((where, f"{quantity}_{p}^2"))
        elif kind == "temperature":
            out.add((where, "temperature"))
    return out
