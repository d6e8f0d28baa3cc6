"""``automap merge``."""

from __future__ import annotations

from pathlib import Path

import click

from pipeline.cli.command import Command
from pipeline.cli.options import ANY_PATH, Finite

_EPILOG = """\b
Examples:
  automap merge maps/* -o city
  automap merge monday/_automap tuesday/_automap -o city
  automap merge maps/* -o city-may --previous city-april
  automap merge maps/* -o city --roads roads.gpkg
"""


@click.command(
    "merge", cls=Command, epilog=_EPILOG, short_help="Make one map from the maps of many drives."
)
@click.argument("folders", nargs=-1, required=True, metavar="OUT...", type=ANY_PATH)
@click.option(
    "-o",
    "--out",
    required=True,
    metavar="MAP",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of the merged map.",
)
@click.option(
    "--previous",
    metavar="MAP",
    type=ANY_PATH,
    help="An older merged map: its names are kept and changes against it are listed. Default: "
    "the map that -o holds already.",
)
@click.option(
    "--min-existence",
    type=Finite(0.0, 1.0),
    default=0.5,
    show_default=True,
    metavar="P",
    help="Signs less likely than this to be there are left out.",
)
@click.option(
    "--roads",
    type=ANY_PATH,
    metavar="FILE",
    help="Lines of roads, as of automap run: signs get road, chainage and side.",
)
@click.option(
    "--background",
    type=ANY_PATH,
    metavar="FILE",
    help="What lies below the report's map, as of automap run.",
)
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
@click.option("--json", "as_json", is_flag=True, help="Print merge.json.")
def command(
    folders: tuple[Path, ...],
    out: Path,
    previous: Path | None,
    min_existence: float,
    roads: Path | None,
    background: Path | None,
    quiet: bool,
    as_json: bool,
) -> None:
    """Make one map from the output folders of many drives.

    Each drive's position error, which its signs share, is estimated and taken off; a sign seen
    by several drives becomes one, with the covariance of their mean; one that was not seen
    although it should have been loses belief.
    """
    from pipeline.merge.command import merge_runs
    from pipeline.merge.terminal import summary_lines
    from pipeline.shared.terminal import progress_bar

    with progress_bar("merge", not (quiet or as_json)) as progress:
        outcome = merge_runs(folders, out, previous, min_existence, progress, roads, background)
    for text in outcome.warnings:
        click.echo(click.style("warning: ", fg="yellow") + text, err=True)
    if as_json:
        click.echo(outcome.files[-1].read_text(encoding="utf-8"), nl=False)
    elif not quiet:
        for line in summary_lines(outcome):
            click.echo(line)
