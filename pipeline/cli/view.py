"""``automap view``."""

from __future__ import annotations

from pathlib import Path

import click

from pipeline.cli.command import Command
from pipeline.cli.options import ANY_PATH

_EPILOG = """\b
Examples:
  automap view data/sample-drive/_automap
  automap view maps --port 8010 --no-browser
  automap view maps --background city.mbtiles --reviewer Anna
"""


@click.command("view", cls=Command, epilog=_EPILOG, short_help="Look at a map and review it.")
@click.argument("out", type=ANY_PATH)
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, help="Port of 127.0.0.1. Default: any."
)
@click.option(
    "--background",
    metavar="FILE",
    type=ANY_PATH,
    help="What lies below the map: PMTiles, MBTiles, GeoTIFF, GeoPackage, or lines. Default: "
    "the drive's own.",
)
@click.option("--reviewer", metavar="NAME", default="", help="Who reviews; stands in every export.")
@click.option("--browser/--no-browser", default=True, help="Open the page, or only say where.")
def command(out: Path, port: int, background: Path | None, reviewer: str, browser: bool) -> None:
    """Show the map in OUT on a page in the browser, and keep what a reviewer decides.

    OUT is the folder of a run or of a merged map. Decisions go into review.json there and are
    applied by the next run or export. Only this machine can open the page, with the address
    that is printed.
    """
    from automap.errors import ConfigError
    from pipeline.view.command import view

    if background is not None and not background.is_file():
        raise ConfigError(f"--background {background}: no such file.")
    view(out, port, browser, click.echo, background, reviewer)
