"""``configs/default.toml``, made of the sections: ``python -m pipeline.settings.defaults``."""

from __future__ import annotations

import math

from automap.io.toml_file import toml_value
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
        stated = f"{name} = {toml_value(getattr(section, name), _number)}"
        note = " ".join((info.description or "").split())
        lines.append(f"{stated:<{_WIDTH}}  # {note}\n")
    return "".join(lines)


def _number(value: float) -> str:
    """All digits, of small numbers with an exponent."""
    if not 0.0 < abs(value) < 2e-3:
        return repr(value)
    exponent = math.floor(math.log10(abs(value)))
    return f"{value / 10.0**exponent:.12g}e{exponent}"


if __name__ == "__main__":
    (configs_dir() / "default.toml").write_text(default_toml(), encoding="utf-8")
