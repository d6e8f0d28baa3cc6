"""``automap check``."""

from __future__ import annotations

import json
from pathlib import Path

import click

from automap.errors import AutoMapError
from pipeline.cli.command import Command, debug_wanted, show_failure
from pipeline.cli.options import ANY_PATH

_EPILOG = """\b
Examples:
  automap check data/sample-drive
  automap check drives/* --json
"""


@click.command("check", cls=Command, epilog=_EPILOG, short_help="Say what a drive folder holds.")
@click.argument("drives", nargs=-1, required=True, metavar="DRIVE", type=ANY_PATH)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object, or a list of them.")
def command(drives: tuple[Path, ...], as_json: bool) -> int:
    """Say what was found in every file of a drive folder, what looks wrong, and what to do.

    The exit code is 3 when the drive cannot be used.
    """
    from pipeline.check.command import check_drive

    code = 0
    reports = []
    for drive in drives:
        try:
            report = check_drive(drive)
        except AutoMapError as error:
            show_failure(error, debug_wanted())
            code = max(code, error.exit_code)
            continue
        code = max(code, 0 if report.usable else 3)
        reports.append(report)
        if not as_json:
            click.echo(report.text())
    if as_json:
        values = [report.as_dict() for report in reports]
        shown = values[0] if len(drives) == 1 and values else values
        click.echo(json.dumps(shown, indent=1, ensure_ascii=False))
    return code
