"""What an answer is worth where the truth is in no library."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain, product
from typing import Any

import numpy as np

from tests.hidden_effects.answers import Answer, misfits, noise_claims, rows
from tests.hidden_effects.cases import Drawn
from tests.hidden_effects.evidence import shifts_of, whiten
from tests.hidden_effects.extras import Extras
from tests.hidden_effects.geodesy import Array
from tests.hidden_effects.outside import Outside
from tests.hidden_effects.setting import walks
from tests.hidden_effects.sizes import STOCHASTIC, DrawnEffect
from tests.hidden_effects.told import Term, terms_of, told_extras

SAME_SHARE = 0.9
"""Share of the disagreement from which on two formulas are one for every use: what is
left is less than a third of the size."""
SAME_NATS = 5.0
"""Nats below which two formulas cannot be told apart."""
OF_BODY = {"imu_yaw": ("nhc_y", -1.0), "imu_pitch": ("nhc_z", 1.0)}
"""Where a vehicle that turns against its way shows, by its speed times the angle to that side."""
FLAGGED = ("formula right", "misfit right", "noise right", "flagged", "resembles")
"""Outcomes in which something is said to be missing where it is."""


def equivalent(drawn: Drawn, answer: Answer, found: Mapping[str, DrawnEffect]) -> float | None:
    """Share of the disagreement of both days that the answer's formulas and names take away; 1
    where what is left cannot be seen, None where the answer has no formula that can be computed.

    Both, since what happens once, late on the first day, may not happen on the shorter other one.
    """
    try:
        true = _innovations(drawn, dict(drawn.case.effects), drawn.extras())
        # all formulas together: a sine and a cosine may be two
        told = [_readings(odd) for odd in rows(answer, "formulas") or [answer.get("unexplained")]]
        left = min(
            float(((true - _innovations(drawn, found, told_extras(terms))) ** 2).sum())
            for terms in (tuple(chain(*each)) for each in product(*told))
        )
    except ValueError:
        return None
    if 0.5 * left < SAME_NATS:
        return 1.0
    return 1.0 - left / max(float((true**2).sum()), 1e-12)


def _readings(odd: Mapping[str, Any] | None) -> list[tuple[Term, ...]]:
    """What an answer's formula says: as it stands and, where the answer states that to its data a
    vehicle that turns as much against its way is the same, as that."""
    terms = terms_of(odd)
    if odd is None or "vehicle" not in str(odd.get("same_as") or ""):
        return [terms]
    of_body = tuple(
        Term(OF_BODY[t.channel][0], f"speed * {t.formula}", OF_BODY[t.channel][1] * t.coefficient)
        for t in terms
        if t.channel in OF_BODY
    )
    return [terms, of_body] if len(of_body) == len(terms) else [terms]


def _innovations(drawn: Drawn, effects: Mapping[str, DrawnEffect], extras: Extras) -> Array:
    hidden = list(drawn.case.effects)
    out = []
    for scene, setting in ((drawn.scene, drawn.setting), (drawn.held_out, drawn.again)):
        shifts = shifts_of(scene, [effects], setting.warm_up, extras)
        drift = walks(setting)
        white = whiten(scene, shifts, setting.imu, setting.gnss, *drift, without=hidden)
        out.append(white.nu)
    return np.concatenate(out)


def outside_outcome(
    outside: Outside,
    answer: Answer,
    shown: Sequence[Mapping[str, Any]],
    share: float | None,
) -> tuple[str, list[str]]:
    """An outcome in a word, and the names that are wrong with confidence.

    ``share`` is what the named and the formula take away together (``equivalent``).
    """
    names = [str(f["effect"]) for f in shown]
    stated = misfits(answer)
    here = [m for m in stated if str(m["channel"]) in outside.shows]
    placed = [m for m in here if str(m["kind"]) in outside.when]
    same = share is not None and share >= SAME_SHARE
    odd = answer.get("unexplained")
    if same and odd is not None:
        return "formula right", []
    if same and names and not set(names) & STOCHASTIC:
        # the names are the truth for every use of it
        return "alike", []
    if placed:
        return "misfit right", []
    if outside.noise and noise_claims(answer):
        return "noise right", []
    if here:
        return "flagged", []
    if odd is not None:
        right = _in_channel(outside, odd)
        if right:
            return "resembles" if odd.get("resembles") else "flagged", []
        return "elsewhere", []
    if names and all(f.get("resembles") for f in shown):
        return "resembles", []
    if outside.kind in names:
        # the library has it by this name since
        return "alike", []
    sure = [n for n in names if n not in STOCHASTIC]
    if sure:
        return "wrong", sure
    if names or noise_claims(answer):
        return "as noise", []
    return ("elsewhere", []) if stated else ("silent", [])


def _in_channel(outside: Outside, odd: Mapping[str, Any]) -> bool:
    """Whether a formula stands on the sensor, the receiver or the vehicle that errs."""
    places = {t.channel for terms in _readings(odd) for t in terms} or {str(odd["channel"])}
    return any(_family(place) & _true_families(outside) for place in places)


def _true_families(outside: Outside) -> set[str]:
    if outside.channel.startswith(("gyro", "accel", "position", "velocity", "height")):
        return _family(outside.channel)
    # a clock or a bracket bends both triads, a swaying car its constraint and both
    whole = {
        "imu": {"gyro", "accel", "imu"},
        "antenna": {"position", "velocity"},
        "camera": {"camera"},
    }
    return whole.get(outside.channel.split()[0], {"gyro", "accel", "nhc"})


def _family(channel: str) -> set[str]:
    stem = channel.split("_")[0]
    # heights and positions, down or along, are the receiver's place
    return {"position"} if stem == "height" else {stem}
