"""``automap regress``."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click

from pipeline.cli.command import Command
from pipeline.cli.options import ANY_PATH, Finite, settings_options

_EPILOG = """\b
Examples:
  automap regress drives/* --update
  automap regress drives/*
  automap regress drives/golf-03 --set fuse.iterations=2 --all

\b
Exit codes: 0 nothing moved by more than its stated sigma allows, 5 something
did.
The same as tests: pytest with automap_drives = ["drives/*"] under
[tool.pytest.ini_options].
"""


@click.command(
    "regress", cls=Command, epilog=_EPILOG, short_help="Compare drives with their stored results."
)
@click.argument("drives", nargs=-1, required=True, metavar="DRIVE...", type=ANY_PATH)
@click.option(
    "--baseline",
    type=click.Path(path_type=Path, dir_okay=False, readable=False),
    default=Path("automap-baseline.json"),
    show_default=True,
    metavar="FILE",
    help="The stored figures.",
)
@click.option("--update", is_flag=True, help="Show what has changed and store it after asking.")
@click.option("--yes", is_flag=True, help="With --update: store without asking.")
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help="Work folder for the runs and regress.html. Default: _regress beside the baseline.",
)
@click.option(
    "--jobs", type=click.IntRange(min=1), default=1, show_default=True, help="Drives at a time."
)
@settings_options("TOML file with settings for the runs.")
@click.option(
    "--tolerance",
    type=Finite(min=0, min_open=True),
    default=0.1,
    show_default=True,
    metavar="SIGMAS",
    help="What a figure may move, in its stated sigmas; single epochs and signs three times it.",
)
@click.option("--all", "everything", is_flag=True, help="List every figure, moved or not.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def command(
    drives: tuple[Path, ...],
    baseline: Path,
    update: bool,
    yes: bool,
    out: Path | None,
    jobs: int,
    config: Path | None,
    assignments: tuple[str, ...],
    tolerance: float,
    everything: bool,
    as_json: bool,
) -> int:
    """Run drives afresh and compare them with stored figures.

    Compared are trajectory, sign map, clock, calibration and processor time. A figure may move
    by a tenth of its own stated sigma; what moved further is listed, regress.html lays both
    maps over one another, and the exit code is 5. --update stores the new figures.
    """
    from automap.errors import ConfigError
    from automap.regression.change import Tolerance
    from pipeline.regress.command import Request, as_dict, regress, store
    from pipeline.regress.table import lines_of
    from pipeline.settings.load import load_settings

    if yes and not update:
        raise ConfigError("--yes belongs to --update; leave it out, or add --update")
    if update and not yes and (as_json or not sys.stdin.isatty()):
        raise ConfigError("--update asks before it stores; from a script add --yes")
    request = Request(
        drives=drives,
        baseline=baseline,
        work=out,
        settings=load_settings(config, assignments),
        jobs=jobs,
        allowed=Tolerance().scaled(tolerance),
        new_drives_welcome=update,
    )
    session = regress(request, lambda text: click.echo(text, err=True))
    if as_json:
        click.echo(json.dumps(as_dict(session), indent=1, ensure_ascii=False))
    else:
        for result in session.results:
            for line in lines_of(result, everything):
                click.echo(line)
        click.echo(str(session.page))
    if not update:
        return session.exit_code
    if yes or click.confirm(f"{session.question} Store?", default=False):
        click.echo(store(session, request), err=as_json)
        return session.failure_code
    click.echo("nothing stored", err=True)
    return session.exit_code
