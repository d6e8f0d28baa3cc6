"""``automap import``."""

from __future__ import annotations

from pathlib import Path

import click

from pipeline.cli.command import Command

_EPILOG = """\b
Example:
  automap import comma2k19 comma2k19/segment -o drives/comma
"""

_IMPORTERS = {"comma2k19": "import_comma2k19"}


@click.command(
    "import", cls=Command, epilog=_EPILOG, short_help="Make a drive folder of another recording."
)
@click.argument("kind", type=click.Choice(list(_IMPORTERS)))
@click.argument("source", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--out",
    required=True,
    metavar="DRIVE",
    type=click.Path(path_type=Path),
    help="The drive folder to write.",
)
def command(kind: str, source: Path, out: Path) -> None:
    """Make a drive folder of a recording in another form (KIND: comma2k19)."""
    from pipeline import importers

    for text in getattr(importers, _IMPORTERS[kind])(source, out):
        click.echo(f"warning: {text}", err=True)
    click.echo(str(out))
