"""``automap detect``."""

from __future__ import annotations

from pathlib import Path

import click

from pipeline.cli.command import Command

_EPILOG = """\b
Examples:
  automap detect data/sample-drive -o detections.csv
  automap detect drive.mp4 -o detections.csv
"""


@click.command("detect", cls=Command, epilog=_EPILOG, short_help="Find signs in a video or images.")
@click.argument("source", type=click.Path(path_type=Path), metavar="VIDEO|IMAGE_DIR|DRIVE")
@click.option(
    "-o",
    "--out",
    required=True,
    metavar="FILE.csv",
    type=click.Path(path_type=Path, dir_okay=False),
    help="The table to write: one row per box.",
)
def command(source: Path, out: Path) -> None:
    """Find road signs in a video, a folder of images or a drive."""
    from pipeline.detect import detect_to_csv
    from pipeline.terminal import progress_bar

    with progress_bar("detect") as progress:
        detect_to_csv(source, out, progress)
    click.echo(str(out))
