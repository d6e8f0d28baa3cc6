"""Users' effects out of tables of formulas, and back."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Any

from automap.effects.formula_text import parse_formula
from automap.effects.user import UserEffect, UserTerm, user_effect
from automap.errors import ConfigError

_KEYS = ("on", "formula", "prior_sd", "unit")


def effects_of_formulas(tables: Mapping[str, Any], source: str) -> list[UserEffect]:
    """The effects of tables: name -> ``summary`` and parameter -> on, formula, prior_sd, unit.

    Raises:
        ConfigError: with the key in ``source`` that is wrong.
    """
    out = []
    for name, table in tables.items():
        place = f"{source}: effects.formulas.{name}"
        if not isinstance(table, Mapping):
            raise ConfigError(f"{place} is no table; write its parameters under it")
        summary = table.get("summary", "an effect of the user's")
        if not isinstance(summary, str):
            raise ConfigError(f"{place}.summary is {summary!r}; give a text")
        terms = [
            _term(str(key), value, f"{place}.{key}")
            for key, value in table.items()
            if key != "summary"
        ]
        try:
            out.append(user_effect(name, summary, *terms))
        except ConfigError as error:
            raise ConfigError(f"{source}: {error}") from None
    return out


def _term(parameter: str, given: Any, place: str) -> UserTerm:
    if not isinstance(given, Mapping):
        raise ConfigError(
            f'{place} is {given!r}; write {{ on = "accel_x", formula = "sin(heading)", '
            "prior_sd = 0.05 }"
        )
    for key in given:
        if key not in _KEYS:
            near = difflib.get_close_matches(str(key), _KEYS, n=1)
            hint = f"did you mean {near[0]}?" if near else "it may have " + ", ".join(_KEYS)
            raise ConfigError(f"{place}: unknown key {key}; {hint}")
    for key in _KEYS[:3]:
        if key not in given:
            raise ConfigError(f"{place}: the key {key} is missing; add it")
    sd = given["prior_sd"]
    if isinstance(sd, bool) or not isinstance(sd, int | float):
        raise ConfigError(f"{place}.prior_sd is {sd!r}; give a number above 0")
    for key in ("on", "formula", "unit"):
        if not isinstance(given.get(key, ""), str):
            raise ConfigError(f"{place}.{key} is {given[key]!r}; give a text")
    try:
        formula = parse_formula(given["formula"])
    except ConfigError as error:
        raise ConfigError(f"{place}: {error}") from None
    return UserTerm(parameter, given["on"], formula, float(sd), given.get("unit", ""), formula.text)


def as_table(effect: UserEffect) -> dict[str, Any] | None:
    """The table of an effect whose terms are all formulas, else None."""
    if not all(t.formula for t in effect.formulas):
        return None
    table: dict[str, Any] = {"summary": effect.summary}
    for t in effect.formulas:
        table[t.parameter] = {
            "on": t.on,
            "formula": t.formula,
            "unit": t.unit,
            "prior_sd": t.prior_sd,
        }
    return table
