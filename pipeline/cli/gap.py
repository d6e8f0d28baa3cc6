"""``automap gap``."""

from __future__ import annotations

from pathlib import Path

import click

from pipeline.cli.command import Command

_EPILOG = """\b
Examples:
  automap gap drives/golf-03 -o gap
  automap gap drives/golf-03 drives/golf-04 --holdout drives/golf-05 -o gap
  automap run drives/golf-06 --config gap/model.toml
"""


@click.command(
    "gap", cls=Command, epilog=_EPILOG, short_help="Name what the sensor model of a drive lacks."
)
@click.argument(
    "drives", nargs=-1, required=True, metavar="DRIVE...", type=click.Path(path_type=Path)
)
@click.option(
    "--holdout",
    multiple=True,
    metavar="DRIVE",
    type=click.Path(path_type=Path),
    help="A drive on which the gap is measured; repeat for several. Default: the last third of "
    "each drive.",
)
@click.option(
    "--config",
    type=click.Path(path_type=Path),
    metavar="MODEL",
    help="The model whose gap is wanted, as settings of the fusion. Default: the base model.",
)
@click.option(
    "--without",
    multiple=True,
    metavar="EFFECT",
    help="An effect that is not to be tried; repeat for several.",
)
@click.option(
    "-o",
    "--out",
    required=True,
    metavar="DIR",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for gap.json, model.toml and gap.html.",
)
def command(
    drives: tuple[Path, ...],
    holdout: tuple[Path, ...],
    config: Path | None,
    without: tuple[str, ...],
    out: Path,
) -> None:
    """Say where model and measurement disagree, and name the missing effect.

    Fits the model to the drives, looks for what their innovations still show, and adds one
    effect after another while held-out data confirm it.
    """
    from pipeline.gap import find
    from pipeline.terminal import progress_bar

    with progress_bar("gap") as progress:
        outcome = find(drives, holdout, config, without, out, progress)
    for line in outcome.lines:
        click.echo(line)
    for path in outcome.files:
        click.echo(str(path))
