"""Pages of the reference that are made from the program itself, so that they cannot go stale."""

from __future__ import annotations

import importlib
import tomllib
from pathlib import Path
from typing import Any

import click

ROOT = Path(__file__).parents[2]

_FAMILIES = {
    "imu": "Errors of the inertial sensors",
    "noise": "Random walks",
    "clock": "Clocks",
    "gnss": "Receiver",
    "vehicle": "Vehicle and installation",
    "earth": "Earth",
    "camera": "Camera",
}


def pages() -> dict[str, str]:
    """Path below docs and text of every generated page."""
    return {
        "reference/effects.md": effects(),
        "reference/commands.md": commands(),
        "reference/configuration.md": configuration(),
        "reference/sign-fields.md": sign_fields(),
        "reference/exit-codes.md": exit_codes(),
        "contributing.md": from_root("CONTRIBUTING.md"),
        "changelog.md": from_root("CHANGELOG.md"),
    }


def from_root(name: str) -> str:
    """A page that lies beside the code, its links as they are on the site."""
    return (ROOT / name).read_text(encoding="utf-8").replace("](docs/", "](")


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "&lt;").replace("\n", " ")


def _table(header: list[str], rows: list[list[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def effects() -> str:
    """Every effect of the catalogue with its parameters, units and priors."""
    from automap.effects.catalogue import CATALOGUE

    text = [
        "# Effects",
        "The sensor model is a list of named effects. Simulator, estimator, configuration, "
        "`automap gap` and the reports use these names. Reading = true value + sum of the "
        "effects. The prior is one sigma before a drive has said anything.",
    ]
    families = list(dict.fromkeys(effect.family for effect in CATALOGUE.values()))
    for family in families:
        text.append(f"## {_FAMILIES.get(family, family)}")
        rows = []
        for effect in CATALOGUE.values():
            if effect.family != family:
                continue
            parameters = ", ".join(f"`{p.name}`" for p in effect.parameters) or "on or off"
            units = ", ".join(dict.fromkeys(p.unit or "1" for p in effect.parameters))
            priors = ", ".join(dict.fromkeys(f"{p.prior_sd:g}" for p in effect.parameters))
            rows.append([f"`{effect.name}`", _cell(effect.summary), parameters, units, priors])
        text.append(_table(["name", "what it is", "parameters", "unit", "prior"], rows))
    return "\n\n".join(text) + "\n"


def commands() -> str:
    """The help of every command and subcommand."""
    from pipeline.cli.root import cli

    text = ["# Commands", "The help that `automap COMMAND --help` prints."]
    context = click.Context(cli, info_name="automap", terminal_width=88, max_content_width=88)
    text += _help(cli, context, 2)
    return "\n\n".join(text) + "\n"


def _help(command: click.Command, context: click.Context, level: int) -> list[str]:
    parts = [f"{'#' * level} {context.command_path}", f"```text\n{command.get_help(context)}\n```"]
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            inner = command.get_command(context, name)
            if inner is not None and not inner.hidden:
                below = click.Context(
                    inner, info_name=name, parent=context, terminal_width=88, max_content_width=88
                )
                parts += _help(inner, below, min(level + 1, 4))
    return parts


def configuration() -> str:
    """Every setting with its default and what the shipped file says of it."""
    source = (ROOT / "configs" / "default.toml").read_text(encoding="utf-8")
    text = [
        "# Configuration",
        "Every setting has a default and a unit. A file given with `--config` replaces single "
        "values, and `--set SECTION.KEY=VALUE` after it.",
    ]
    for section, rows in settings(source).items():
        text.append(f"## {section}")
        cells = [[f"`{key}`", f"`{_cell(value)}`", _cell(note)] for key, value, note in rows]
        empty = "This section has no settings."
        text.append(_table(["key", "default", "meaning"], cells) if cells else empty)
    return "\n\n".join(text) + "\n"


def settings(source: str) -> dict[str, list[tuple[str, str, str]]]:
    """Sections of a TOML file with one setting a line: key, value as written, comment."""
    sections: dict[str, list[tuple[str, str, str]]] = {}
    rows: list[tuple[str, str, str]] = []
    for line in source.splitlines():
        if line.startswith("["):
            rows = sections.setdefault(line.strip("[] "), [])
        elif "=" in line and not line.startswith("#"):
            key, _, rest = line.partition("=")
            value, note = _split_comment(rest)
            rows.append((key.strip(), value, note))
    return sections


def _split_comment(text: str) -> tuple[str, str]:
    """A value and the comment after it; a # within quotes is no comment."""
    for at, character in enumerate(text):
        if character == "#":
            try:
                tomllib.loads(f"x = {text[:at]}")
            except tomllib.TOMLDecodeError:
                continue
            return text[:at].strip(), text[at + 1 :].strip()
    return text.strip(), ""


def sign_fields() -> str:
    """The data dictionary of a sign."""
    from automap.export.fields import SIGN_FIELDS

    rows = [[f"`{f.name}`", f.kind, f.unit, _cell(f.meaning)] for f in SIGN_FIELDS]
    return (
        "# Fields of a sign\n\nEvery format writes these fields under these names. Positions are "
        "WGS-84, covariances total: the trajectory's own uncertainty is in them.\n\n"
        + _table(["field", "kind", "unit", "meaning"], rows)
    )


def exit_codes() -> str:
    """The codes of the failures, from the classes themselves."""
    errors: Any = importlib.import_module("automap.errors")
    found: dict[int, str] = {0: "Done."}
    for name in ("ConfigError", "InputError", "StageError", "RegressionError"):
        kind = getattr(errors, name)
        found[kind.exit_code] = (kind.__doc__ or "").strip().splitlines()[0]
    found[130] = (
        "Interrupted; nothing half-written is left. `run`, `gap`, `regress` and `experiment` "
        "resume, the others start over."
    )
    rows = [[str(code), _cell(meaning)] for code, meaning in sorted(found.items())]
    return (
        "# Exit codes\n\n"
        + _table(["code", "meaning"], rows)
        + "\nWith several drives it is the highest. `automap check` gives 3 for a drive that is "
        "not usable, `automap evaluate --require` and `automap regress` give 5 for a figure that "
        "is missed, `automap run --strict` for a path or signs that are doubtful or "
        "unusable. An error is "
        "one sentence with the file, the line or byte, and what to do; `--debug` adds the "
        "traceback.\n"
    )
