"""``automap gap``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pipeline.cli.calibrate import _log_options, _place, _source
from pipeline.cli.command import Command
from pipeline.cli.options import ANY_PATH, Finite

if TYPE_CHECKING:
    from pipeline.gap.command import GapOutcome

_EPILOG = """\b
Examples:
  automap gap drives/golf-03 -o gap
  automap gap drives/golf-03 drives/golf-04 --holdout drives/golf-05 -o gap
  automap run drives/golf-06 --config gap/model.toml
  automap gap desk.txt --columns ax,ay,az,gx,gy,gz --rate 100 \\
      --gravity 9.8174 -o gap
"""


@click.command(
    "gap", cls=Command, epilog=_EPILOG, short_help="Name what the sensor model of a drive lacks."
)
@click.argument("drives", nargs=-1, metavar="DRIVE...|LOG...", type=ANY_PATH)
@_log_options
@click.option(
    "--holdout",
    multiple=True,
    metavar="DRIVE",
    type=ANY_PATH,
    help="A drive on which the gap is measured; repeat for several. Default: the last third of "
    "each drive.",
)
@click.option(
    "--config",
    type=ANY_PATH,
    metavar="MODEL",
    help="The model whose gap is wanted, as settings of the fusion. Default: the base model.",
)
@click.option(
    "--without",
    multiple=True,
    metavar="EFFECT",
    help="An effect that is not to be tried; repeat for several.",
)
@click.option("--gravity", type=Finite(), metavar="G", help="Of a desk log: local gravity, m/s^2.")
@click.option("--place", callback=_place, metavar="LAT,HEIGHT", help="Or where the desk stands.")
def command(
    drives: tuple[Path, ...],
    holdout: tuple[Path, ...],
    config: Path | None,
    without: tuple[str, ...],
    gravity: float | None,
    place: tuple[float, float] | None,
    **options: Any,
) -> None:
    """Say where model and measurement disagree, and name the missing effect.

    Fits the model to the drives, looks for what their innovations still show, and adds one
    effect after another while held-out data confirm it. A LOG of rest poses, as automap calibrate
    static takes it, is searched for what the accelerometer's six-parameter model lacks.
    """
    from automap.errors import ConfigError
    from pipeline.gap.command import find_in_logs

    out = options["out"]
    desk = options["accel"] is not None or options["gyro"] is not None or options["columns"]
    if not drives and not desk:
        raise ConfigError("give a DRIVE, or --accel FILE and --gyro FILE of a desk log")
    if desk or all(d.is_file() and d.suffix != ".toml" for d in drives):
        if holdout or config:
            raise ConfigError("--holdout and --config belong to drives; leave them out for a log")
        outcome = find_in_logs(_source(drives, options), out, gravity, place, without)
    else:
        outcome = _on_drives(drives, holdout, config, without, out)
    for line in outcome.lines:
        click.echo(line)
    for path in outcome.files:
        click.echo(str(path))


def _on_drives(
    drives: tuple[Path, ...],
    holdout: tuple[Path, ...],
    config: Path | None,
    without: tuple[str, ...],
    out: Path,
) -> GapOutcome:
    from pipeline.gap.command import find
    from pipeline.shared.terminal import progress_bar

    with progress_bar("gap") as progress:
        return find(drives, holdout, config, without, out, progress)
