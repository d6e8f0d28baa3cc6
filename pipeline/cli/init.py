"""``automap init``."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence
from pathlib import Path

import click

from pipeline.cli.command import Command
from pipeline.cli.import_kinds import KINDS
from pipeline.cli.options import ANY_PATH

_EPILOG = """\b
Examples:
  automap init recordings/monday
  automap init recordings/monday -o drives/monday --yes
  automap init recordings/drive.mcap -o drives/tuesday
"""


@click.command(
    "init", cls=Command, epilog=_EPILOG, short_help="Make a drive of a folder of recordings."
)
@click.argument("folder", metavar="FOLDER", type=ANY_PATH)
@click.option(
    "-o", "--out", type=ANY_PATH, metavar="DRIVE", help="Make the drive there, not in FOLDER."
)
@click.option("--yes", is_flag=True, help="Ask nothing, take what is likeliest.")
@click.option("--force", is_flag=True, help="Write a drive.toml anew that is there.")
def command(folder: Path, out: Path | None, yes: bool, force: bool) -> int:
    """Look at the recordings in FOLDER and write the drive.toml that makes it a drive.

    Tables, receiver logs and videos are told apart by what is in them, columns by their names,
    units, times and axes by their names and by the readings; each line of the file says why. ROS
    bags, phone logs, a GoPro's video and data sets are imported, into FOLDER/drive where -o names
    no other. FOLDER may be a single file. What cannot be known is asked, on a terminal only.

    It ends with automap check and has its exit code: 3 when the drive cannot be used.
    """
    from pipeline.check.command import check_drive
    from pipeline.init.command import init_drive

    ask = None if yes or not sys.stdin.isatty() else _ask
    outcome = init_drive(folder, out, _convert, ask, force)
    for text in outcome.told:
        click.echo(text, err=True)
    report = check_drive(outcome.drive)
    click.echo(report.text())
    return 0 if report.usable else 3


def _convert(kind: str, paths: list[Path], out: Path) -> list[str]:
    module, _, name = KINDS[kind].function.partition(":")
    source = paths if KINDS[kind].several else paths[0]
    warnings: list[str] = getattr(importlib.import_module(module), name)(source, out)
    return [f"warning: {text}" for text in warnings]


def _ask(question: str, answers: Sequence[str]) -> str:
    kind = click.Choice(answers) if answers else str
    default = answers[0] if answers else ""
    return str(click.prompt(question, type=kind, default=default, show_default=bool(answers)))
