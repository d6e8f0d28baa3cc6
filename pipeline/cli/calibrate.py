"""``automap calibrate static|dynamic|allan``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from pipeline.cli.command import Command
from pipeline.cli.options import ANY_PATH, Finite

if TYPE_CHECKING:
    from pipeline.calibrate.logs import LogSource
    from pipeline.calibrate.output import Outcome

F = TypeVar("F", bound=Callable[..., Any])

_EPILOG = """\b
A LOG is a drive folder, a CSV with named columns, or, with --columns, plain
numbers.
Examples:
  automap calibrate static desk.csv --place 48.14,560 -o calibration
  automap calibrate static --accel ACC.txt --gyro GYRO.txt \\
      --columns t_s,x,y,z --accel-unit counts --gyro-unit counts \\
      --gravity 9.81744 -o calibration
"""


def _columns(ctx: click.Context, param: click.Parameter, value: str | None) -> tuple[str, ...]:
    if value is None:
        return ()
    names = tuple(part.strip().lower() for part in value.replace(" ", ",").split(",") if part)
    known = {*"xyz", "-", "t_s", "t_ms", "t_us", "t_ns", "temp_c"}
    known |= {f"{sensor}{axis}" for sensor in "ag" for axis in "xyz"}
    wrong = [name for name in names if name not in known]
    if wrong:
        raise click.BadParameter(f"{wrong[0]} is no column; known are {', '.join(sorted(known))}")
    return names


def _place(
    ctx: click.Context, param: click.Parameter, value: str | None
) -> tuple[float, float] | None:
    if value is None:
        return None
    try:
        latitude, height = (float(part) for part in value.split(","))
    except ValueError:
        raise click.BadParameter("give LATITUDE,HEIGHT in degrees and metres") from None
    if not (-90.0 <= latitude <= 90.0 and -1000.0 < height < 10000.0):
        raise click.BadParameter("the latitude is in degrees, the height in metres")
    return latitude, height


def _log_options(function: F) -> F:
    path = click.Path(path_type=Path, dir_okay=False, readable=False)
    options = [
        click.option("--accel", type=path, help="Accelerometer alone, as plain numbers."),
        click.option("--gyro", type=path, help="Gyro alone, with the same columns."),
        click.option("--columns", callback=_columns, metavar="NAME,...", help="Columns of plain "
                     "numbers: t_s (or t_ms, t_us, t_ns), ax ... gz, temp_c; x,y,z in files of "
                     "one sensor; - to skip."),
        click.option("--rate", type=Finite(0.1, 1e6), metavar="HZ",
                     help="Samples a second of a log without times."),
        click.option("--gyro-unit", type=click.Choice(["rad/s", "deg/s", "counts"]),
                     help="Default: the drive's, else rad/s."),
        click.option("--accel-unit", type=click.Choice(["m/s^2", "g", "counts"]),
                     help="Default: the drive's, else m/s^2."),
        click.option("--sensor", metavar="NAME", help="Data sheet of counts, in configs/sensors."),
        click.option("-o", "--out", required=True, type=click.Path(path_type=Path, file_okay=False),
                     metavar="DIR", help="Folder for imu_calibration.toml and the report."),
    ]  # fmt: skip
    for option in reversed(options):
        function = option(function)
    return function


def _gravity_options(function: F) -> F:
    options = [
        click.option("--gravity", type=Finite(), metavar="G", help="Local gravity, m/s^2."),
        click.option("--place", callback=_place, metavar="LAT,HEIGHT",
                     help="Where you are, degrees and metres, for gravity of WGS-84."),
        click.option("--apply", is_flag=True, help="Also write the corrected log."),
    ]  # fmt: skip
    for option in reversed(options):
        function = option(function)
    return function


def _source(logs: tuple[Path, ...], options: dict[str, Any]) -> LogSource:
    from pipeline.calibrate.logs import LogSource

    keys = ("accel", "gyro", "columns", "gyro_unit", "accel_unit", "sensor")
    return LogSource(logs=logs, rate_hz=options["rate"], **{key: options[key] for key in keys})


def _show(outcome: Outcome) -> None:
    click.echo(outcome.summary)
    for path in outcome.files:
        click.echo(str(path))


@click.group("calibrate", epilog=_EPILOG, short_help="Calibrate an IMU on a desk.")
def command() -> None:
    """Calibrate an inertial sensor: at rest in many poses, turned by hand, or its noise."""


@command.command("static", cls=Command)
@click.argument("logs", nargs=-1, type=ANY_PATH, metavar="LOG...")
@_log_options
@_gravity_options
@click.option("--parameters", type=click.Choice(["6", "9"]), help="Of the accelerometer; default "
              "9 where the poses allow.")  # fmt: skip
@click.option("--g-sensitivity", is_flag=True, help="Also what the gyro reads of specific force.")
def static_command(
    logs: tuple[Path, ...], parameters: str | None, g_sensitivity: bool, **options: Any
) -> None:
    """Scale, bias and misalignment of both sensors.

    Hold the sensor still for a few seconds in twelve or more poses, all sides up and some in
    between, and turn it by 90 degrees or more from one to the next.
    """
    from pipeline.calibrate.command import static

    _show(
        static(
            _source(logs, options),
            options["out"],
            options["gravity"],
            options["place"],
            None if parameters is None else int(parameters),
            g_sensitivity,
            options["apply"],
        )
    )


@command.command("dynamic", cls=Command)
@click.argument("log", required=False, type=ANY_PATH)
@_log_options
@_gravity_options
@click.option(
    "--calibration",
    type=click.Path(path_type=Path, dir_okay=False, readable=False),
    metavar="FILE",
    help="The static calibration to start from.",
)
def dynamic_command(log: Path | None, calibration: Path | None, **options: Any) -> None:
    """What is left after the static calibration, from one turn-on.

    Turn the sensor in your hand about all three axes, in place, for a minute or two.
    """
    from pipeline.calibrate.command import dynamic

    logs = () if log is None else (log,)
    _show(
        dynamic(
            _source(logs, options),
            options["out"],
            options["gravity"],
            options["place"],
            calibration,
            options["apply"],
        )
    )


@command.command("allan", cls=Command)
@click.argument("log", required=False, type=ANY_PATH)
@_log_options
def allan_command(log: Path | None, **options: Any) -> None:
    """White noise, bias instability and random walk, from a long rest.

    Leave the sensor alone for an hour or more, at even temperature.
    """
    from pipeline.calibrate.command import allan

    _show(allan(_source(() if log is None else (log,), options), options["out"]))
