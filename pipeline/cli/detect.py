"""``automap detect``."""

from __future__ import annotations

from pathlib import Path

import click

from pipeline.cli.command import Command
from pipeline.cli.options import ANY_PATH, settings_options

_EPILOG = """\b
Examples:
  automap detect data/sample-drive -o detections.csv
  automap detect drive.mp4 -o detections.csv --annotate
  automap detect pictures -o detections.csv --detector my-signs.toml
"""


@click.command("detect", cls=Command, epilog=_EPILOG, short_help="Find signs in a video or images.")
@click.argument("source", type=ANY_PATH, metavar="VIDEO|IMAGE_DIR|DRIVE")
@click.option(
    "-o",
    "--out",
    required=True,
    metavar="FILE.csv",
    type=click.Path(path_type=Path, dir_okay=False, readable=False),
    help="The table to write: one row per box.",
)
@click.option("--every-frame", is_flag=True, help="Search every frame of a video.")
@click.option("--annotate", is_flag=True, help="Write the video with the signs drawn in, too.")
@click.option(
    "--detector",
    metavar="FILE.toml",
    type=ANY_PATH,
    help="Describes a detector of your own, an ONNX file.",
)
@settings_options(assignment="Replace one setting, such as detect.min_score=0.5.")
def command(
    source: Path,
    out: Path,
    every_frame: bool,
    annotate: bool,
    detector: Path | None,
    config: Path | None,
    assignments: tuple[str, ...],
) -> None:
    """Find road signs in a video, a folder of images or a drive.

    Frames are chosen by what a map needs: how far the vehicle went and turned, more of them
    where a sign is in sight. Boxes of one sign share a track, and all its views say its class.
    Beside the signs nobody can be recognised in the pictures that are written;
    privacy.hide_street=false leaves them as they are.
    """
    from pipeline.detect.command import detect_to_csv
    from pipeline.settings.load import load_settings
    from pipeline.shared.terminal import progress_bar

    read = load_settings(config, assignments)
    settings = read.detect
    changes: dict[str, object] = {"every_frame": True} if every_frame else {}
    if detector is not None:
        changes["detector"] = str(detector)
    with progress_bar("detect") as progress:
        outcome = detect_to_csv(
            source,
            out,
            progress,
            settings=settings.model_copy(update=changes),
            annotate=annotate,
            hide=read.privacy.hide_street,
        )
    signs = f", {outcome.tracks} signs" if outcome.tracks else ""
    click.echo(f"{outcome.boxes} boxes{signs} in {outcome.searched} of {outcome.frames} pictures")
    for path in outcome.files:
        click.echo(str(path))
