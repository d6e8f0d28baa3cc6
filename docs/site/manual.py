"""The man page ``automap.1``, made from the help of the commands.

``python docs/site/manual.py FOLDER`` writes it; ``make man`` does, and ``make docs`` too.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterator
from pathlib import Path

import click

sys.path.insert(0, str(Path(__file__).parents[2]))

from automap import __version__
from pipeline.cli.root import _GROUPS, cli

NAME = "automap.1"


def manual() -> str:
    """The page in roff with the macros of man(7)."""
    context = click.Context(cli, info_name="automap", help_option_names=["-h", "--help"])
    lines = [
        f'.TH AUTOMAP 1 "" "AutoMap {_plain(__version__)}" "User commands"',
        ".SH NAME",
        r"automap \- from a recorded drive to a map of road signs",
        ".SH SYNOPSIS",
        ".B automap",
        r"[\fIOPTIONS\fR] \fICOMMAND\fR [\fIARGS\fR]",
        ".SH DESCRIPTION",
        *_paragraphs(cli.help or ""),
        ".SH OPTIONS",
        *_options(cli, context),
        ".SH COMMANDS",
    ]
    for title, names in _GROUPS.items():
        lines.append(f".SS {title}")
        for name in names:
            command = cli.get_command(context, name)
            assert command is not None
            lines += [".TP", f".B {name}", _plain(command.get_short_help_str(200))]
    for name in cli.list_commands(context):
        command = cli.get_command(context, name)
        assert command is not None
        lines += _command(command, click.Context(command, info_name=name, parent=context))
    lines += [".SH NOTES", *_paragraphs(cli.epilog or "")]
    return "\n".join(lines) + "\n"


def _command(command: click.Command, context: click.Context) -> Iterator[str]:
    """The section of a command, those of its subcommands after it."""
    yield f'.SH "{_plain(context.command_path)}"'
    usage = " ".join(command.collect_usage_pieces(context))
    yield rf"\fB{_plain(context.command_path)}\fR {_plain(usage)}"
    yield from _paragraphs(command.help or "")
    yield from _options(command, context)
    yield from _paragraphs(command.epilog or "")
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            inner = command.get_command(context, name)
            if inner is not None and not inner.hidden:
                yield from _command(inner, click.Context(inner, info_name=name, parent=context))


def _options(command: click.Command, context: click.Context) -> Iterator[str]:
    for parameter in command.get_params(context):
        record = parameter.get_help_record(context)
        if record is not None:
            yield from (".TP", f".B {_plain(record[0])}", _plain(record[1]) or "\\&")


def _paragraphs(text: str) -> Iterator[str]:
    r"""Paragraphs; those after ``\b`` keep their lines."""
    for paragraph in inspect.cleandoc(text).split("\n\n"):
        rows = paragraph.strip("\n").split("\n")
        if rows[0].strip() == "\b":
            yield from (".PP", ".nf", *map(_plain, rows[1:]), ".fi")
        elif paragraph.strip():
            yield from (".PP", _plain(" ".join(rows)))


def _plain(text: str) -> str:
    """Text in which roff sees no command: a full stop or quote at the start, a backslash, a dash
    that is to be typed."""
    escaped = text.replace("\\", r"\e").replace("-", r"\-")
    return rf"\&{escaped}" if escaped[:1] in (".", "'") else escaped


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    (folder / NAME).write_text(manual(), encoding="utf-8")
    print(folder / NAME)
