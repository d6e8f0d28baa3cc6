"""``automap simulate``."""

from __future__ import annotations

from pathlib import Path

import click

from pipeline.cli.command import Command
from pipeline.cli.options import ANY_PATH

_EPILOG = """\b
Example:
  automap simulate sample -o drives/sample
  automap simulate town --receiver phone -o drives/town-phone
  automap simulate --like drives/monday/_automap -o drives/monday-twin
"""


@click.command("simulate", cls=Command, epilog=_EPILOG, short_help="Make a drive with known truth.")
@click.argument("scenario", required=False)
@click.option(
    "--like",
    metavar="OUT",
    type=ANY_PATH,
    help="Output folder of a run: simulate its drive's twin instead of a scenario.",
)
@click.option(
    "-o",
    "--out",
    required=True,
    metavar="DRIVE",
    type=ANY_PATH,
    help="The drive folder to write.",
)
@click.option(
    "--config",
    metavar="MODEL",
    type=ANY_PATH,
    help="A model as automap gap writes it: the sensors have its errors too, and the scenario may "
    "use the effects that it defines. With --like it only names the Python files of effects that "
    "the run may have used.",
)
@click.option(
    "--receiver",
    default="",
    metavar="NAME",
    help="A receiver of configs/receivers (phone, u-blox, rtk) in place of the scenario's.",
)
@click.option(
    "--replay",
    metavar="ERRORS",
    type=ANY_PATH,
    help="A drive folder with truth, or a table of errors: the receiver errs as the one there did.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    help="Seed of the random errors. Default: the scenario's own.",
)
def command(
    scenario: str | None,
    like: Path | None,
    out: Path,
    config: Path | None,
    receiver: str,
    replay: Path | None,
    seed: int | None,
) -> None:
    """Make a drive folder with sensor data, video and truth.

    SCENARIO is a TOML file or the name of one that comes with automap. With --like the vehicle
    follows the smoothed trajectory of a recorded drive, and its sensors (IMU, receiver, wheel
    speed; no camera) have the errors and the noise that the run found: what differs between the
    recording and its twin, the model does not have.
    """
    from pipeline.shared.terminal import progress_bar
    from pipeline.simulate.command import simulate, simulate_like

    if (scenario is None) == (like is None):
        raise click.UsageError("give a scenario or --like OUT, one of the two")
    if like is not None:
        if receiver or replay is not None:
            raise click.UsageError("--receiver and --replay belong to a scenario")
        simulate_like(like, out, 1 if seed is None else seed, config)
        click.echo(str(out))
        return
    assert scenario is not None

    with progress_bar("simulate") as progress:
        notes = simulate(scenario, out, seed, progress, config, receiver, replay)
    for note in notes:
        click.echo(note, err=True)
    click.echo(str(out))
