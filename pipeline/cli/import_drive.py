"""``automap import``."""

from __future__ import annotations

import importlib
import inspect
from pathlib import Path
from typing import Any

import click

from pipeline.cli.command import Command
from pipeline.cli.import_kinds import KINDS, Kind
from pipeline.cli.options import ANY_PATH

_EPILOG = """\b
Examples:
  automap import comma2k19 comma2k19/segment -o drives/comma
  automap import comma2k19 --help

The drive folder appears whole or not at all; import.json in it says what it was made from.
Then: automap check DRIVE.
"""


class _Kinds(click.Group):
    """A subcommand for each kind, made when it is asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The kinds in the order of the table."""
        return list(KINDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The subcommand of a kind, None when there is none."""
        kind = KINDS.get(cmd_name)
        return None if kind is None else _command(kind)


def _command(kind: Kind) -> click.Command:
    from pipeline.check.command import check_drive

    def run(source: Path | tuple[Path, ...], out: Path, **options: Any) -> int:
        module, _, name = kind.function.partition(":")
        for text in getattr(importlib.import_module(module), name)(source, out, **options):
            click.echo(f"warning: {text}", err=True)
        click.echo(str(out))
        report = check_drive(out)
        for text in report.wrong():
            click.echo(text, err=True)
        return 0 if report.usable else 3

    return Command(
        kind.name,
        callback=run,
        params=[
            click.Argument(
                ["source"],
                metavar=kind.source,
                type=ANY_PATH,
                nargs=-1 if kind.several else 1,
                required=True,
            ),
            click.Option(
                ["-o", "--out"],
                required=True,
                metavar="DRIVE",
                type=ANY_PATH,
                help="The drive folder to write.",
            ),
            *(click.Option(o.flag.split(), help=o.help, **o.settings) for o in kind.options),
        ],
        short_help=kind.summary,
        help=inspect.cleandoc(f"{kind.summary}\n\n{inspect.cleandoc(kind.text)}"),
    )


@click.command(
    "import",
    cls=_Kinds,
    epilog=_EPILOG,
    short_help="Make a drive folder of another recording.",
    subcommand_metavar="KIND SOURCE -o DRIVE",
)
def command() -> None:
    """Make a drive folder of a recording in another form.

    Each KIND has its own help, which says what it reads and what it was tested on.
    """
