"""``configs/default.toml``, made of the sections: ``python -m pipeline.settings.defaults``."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from pipeline.settings.load import Settings
from pipeline.settings.section import Section
from pipeline.shared.configs import configs_dir

_HEAD = """\
# The settings of a run. Every key stands here with its default and its unit; a file given
# with --config, and then --set SECTION.KEY=VALUE, replace single values.
"""
_WIDTH = 24
"""Of key and value, so that comments stand below one another; longer ones push theirs."""


def default_toml() -> str:
    """The text of the file: every section, every key with its default and its comment."""
    settings = Settings()
    return _HEAD + "".join(
        f"\n[{name}]\n{_lines(getattr(settings, name))}" for name in Settings.model_fields
    )


def _lines(section: Section) -> str:
    lines = []
    for name, info in type(section).model_fields.items():
        stated = f"{name} = {_value(getattr(section, name))}"
        note = " ".join((info.description or "").split())
        lines.append(f"{stated:<{_WIDTH}}  # {note}\n")
    return "".join(lines)


def _value(value: Any) -> str:
    """A value as TOML has it; small numbers with an exponent."""
    if isinstance(value, Mapping):
        if value:
            raise TypeError("a table has no default but the empty one")
        return "{}"
    if isinstance(value, float) and 0.0 < abs(value) < 2e-3:
        exponent = math.floor(math.log10(abs(value)))
        return f"{value / 10.0**exponent:.12g}e{exponent}"
    return json.dumps(value, ensure_ascii=False)


if __name__ == "__main__":
    (configs_dir() / "default.toml").write_text(default_toml(), encoding="utf-8")
