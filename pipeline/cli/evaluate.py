"""``automap evaluate``."""

from __future__ import annotations

import json
from pathlib import Path

import click

from automap.errors import RegressionError
from pipeline.cli.command import Command
from pipeline.cli.options import ANY_PATH, Finite

_EPILOG = """\b
Examples:
  automap evaluate data/sample-drive/_automap
  automap evaluate data/sample-drive/_automap \\
      --require "position_rms_m.horizontal<2"
"""


@click.command("evaluate", cls=Command, epilog=_EPILOG, short_help="Compare a map with the truth.")
@click.argument("out", type=ANY_PATH)
@click.option(
    "--truth",
    type=ANY_PATH,
    help="Folder with trajectory.csv or signs.geojson. Default: the drive's truth folder.",
)
@click.option(
    "--truth-sd", type=Finite(0, 1e4), metavar="M", help="One sigma of the truth, metres."
)
@click.option(
    "--require",
    "requirements",
    multiple=True,
    metavar="KEY<VALUE",
    help="A figure that must hold, with < > <= or >=; else the exit code is 5.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON.")
def command(
    out: Path,
    truth: Path | None,
    truth_sd: float | None,
    requirements: tuple[str, ...],
    as_json: bool,
) -> None:
    """Compare the results in OUT with the truth and write evaluation.json there."""
    from pipeline.evaluate.command import check_requirements, evaluate_run
    from pipeline.shared.values import flatten

    result = evaluate_run(out, truth, truth_sd)
    for text in result.get("warnings", ()):
        click.echo(click.style("warning: ", fg="yellow") + text, err=True)
    if as_json:
        click.echo(json.dumps(result, indent=1))
    else:
        for key, value in flatten({k: v for k, v in result.items() if k != "warnings"}).items():
            shown = f"{value:.4g}" if isinstance(value, float) else str(value)
            click.echo(f"{key:<40} {shown}")
    failures = check_requirements(result, list(requirements))
    if failures:
        raise RegressionError(" ".join(failures))
