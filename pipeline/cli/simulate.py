"""``automap simulate``."""

from __future__ import annotations

from pathlib import Path

import click

from pipeline.cli.command import Command

_EPILOG = """\b
Example:
  automap simulate sample -o drives/sample
"""


@click.command("simulate", cls=Command, epilog=_EPILOG, short_help="Make a drive with known truth.")
@click.argument("scenario")
@click.option(
    "-o",
    "--out",
    required=True,
    metavar="DRIVE",
    type=click.Path(path_type=Path),
    help="The drive folder to write.",
)
@click.option("--seed", type=int, help="Seed of the random errors. Default: the scenario's own.")
def command(scenario: str, out: Path, seed: int | None) -> None:
    """Make a drive folder with sensor data, video and truth.

    SCENARIO is a TOML file or the name of one that comes with automap.
    """
    from pipeline.simulate import simulate
    from pipeline.terminal import progress_bar

    with progress_bar("simulate") as progress:
        simulate(scenario, out, seed, progress)
    click.echo(str(out))
