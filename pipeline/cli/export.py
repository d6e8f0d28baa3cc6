"""``automap export``."""

from __future__ import annotations

from pathlib import Path

import click

from pipeline.cli.command import Command

_EPILOG = """\b
Example:
  automap export data/sample-drive/_automap --format csv
"""


@click.command("export", cls=Command, epilog=_EPILOG, short_help="Write a map in another format.")
@click.argument("out", type=click.Path(path_type=Path))
@click.option(
    "--format",
    "form",
    required=True,
    metavar="F",
    help="Signs: geojson, kml, gpkg, parquet, flatgeobuf, csv. "
    "Trajectory: trajectory-csv, pos, tum, kitti, gpx.",
)
@click.option(
    "-o",
    "--output",
    "target",
    type=click.Path(path_type=Path),
    help="File to write. Default: the format's own name in OUT.",
)
def command(out: Path, form: str, target: Path | None) -> None:
    """Write the map in OUT in one more format."""
    from pipeline.export import export_run

    path, warnings = export_run(out, form, target)
    for text in warnings:
        click.echo(f"warning: {text}", err=True)
    click.echo(str(path))
