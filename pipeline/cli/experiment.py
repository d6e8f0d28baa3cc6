"""``automap experiment``."""

from __future__ import annotations

from pathlib import Path

import click

from pipeline.cli.command import Command
from pipeline.cli.options import ANY_PATH, Finite

KINDS = ("calibration", "biases", "nis", "dropout", "rest")
_EPILOG = """\b
Examples:
  automap experiment dropout drives/golf-03 -o plots --outage 15 --every 45
  automap experiment biases drives/golf-03 -o plots
  automap experiment rest calibration/desk_corrected.csv -o plots \\\\
      --bias-at 444
"""


@click.command(
    "experiment",
    cls=Command,
    epilog=_EPILOG,
    short_help="Plot what calibration and smoothing do on a drive.",
)
@click.argument("kind", type=click.Choice(KINDS))
@click.argument("drive", type=ANY_PATH)
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path, file_okay=False))
@click.option("--config", type=ANY_PATH, help="TOML file with settings.")
@click.option("--outage", type=Finite(1.0), default=15.0, help="Seconds without GPS.")
@click.option("--every", type=Finite(5.0), default=45.0, help="Seconds between starts.")
@click.option("--bias-at", type=Finite(), metavar="S", help="For rest: the second whose rest gives "
              "the gyro bias; default: the last.")  # fmt: skip
def command(
    kind: str,
    drive: Path,
    out: Path,
    config: Path | None,
    outage: float,
    every: float,
    bias_at: float | None,
) -> None:
    """Repeat one of the paper's experiments on DRIVE; writes KIND.png and KIND.json.

    calibration: forward filter through GPS outages with and without estimated sensor errors.
    biases: sensor biases over time with sigma. nis: are the innovations as large as the filter
    says. dropout: GPS cut off, with and without smoothing. rest: roll and pitch of a resting
    sensor with and without dynamic calibration, simulated and in the rests of DRIVE, which
    may also be a log of an IMU alone, in units.
    """
    from automap.errors import ConfigError

    if kind == "rest":
        from pipeline.experiments import rest

        for line in rest.table(rest.run(drive, out, bias_at)):
            click.echo(line)
        click.echo(f"{out / 'rest.png'}")
        return
    from pipeline.experiments import biases, calibration, dropout, nis
    from pipeline.experiments.base import prepare
    from pipeline.settings.load import load_settings
    from pipeline.shared.values import flatten

    if every < outage + 5.0:
        raise ConfigError(
            f"--every {every:g} leaves less than 5 s of GPS between outages of {outage:g} s; "
            "choose a longer period"
        )
    experiment = prepare(drive, out, load_settings(config))
    if kind == "calibration":
        result = calibration.run(experiment, outage, every)
    elif kind == "biases":
        result = biases.run(experiment)
    elif kind == "nis":
        result = nis.run(experiment)
    else:
        result = dropout.run(experiment, outage, every)
    for name, value in flatten(result).items():
        click.echo(f"{name:32s} {value if not isinstance(value, float) else f'{value:.4g}'}")
    click.echo(f"{out / (kind + '.png')}")
