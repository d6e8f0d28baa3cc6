"""``automap record``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pipeline.cli.command import Command
from pipeline.cli.options import ANY_PATH, Finite

_SHOWN = 12
_EPILOG = """\b
Examples:
  automap record --list-ports
  automap record -o drives/monday
  automap record --gnss /dev/ttyACM0 --rate 5 --raw \\
      --imu /dev/ttyUSB0@115200 --imu-format thinimu-micro \\
      --rig drives/sunday --camera front=/dev/video0
  automap record --restore-receiver drives/monday
  automap record --replay data/sample-drive --links /tmp/car

\b
Ctrl-C ends a recording (exit code 0; 130 before the end of --duration; 3
where nothing readable came in). What is recorded is a drive folder: automap
check and automap run take it as it is. docs/record.md tells the rest.
"""


@click.command("record", cls=Command, epilog=_EPILOG, short_help="Record a drive.")
@click.option(
    "-o",
    "--out",
    metavar="DRIVE",
    type=ANY_PATH,
    help="The drive folder to write. Default: drive-DATE-TIME.",
)
@click.option(
    "--gnss",
    default="auto",
    metavar="PORT",
    help="Port of the receiver, PORT@BAUD where the rate is known, or none. Default: found.",
)
@click.option(
    "--imu",
    default="auto",
    metavar="PORT",
    help="Port of the inertial sensor, likewise. Default: found.",
)
@click.option(
    "--imu-format",
    metavar="NAME",
    help="What its lines look like: a file of configs/imu_lines/, or one of your own (.toml). "
    "Default: found among those.",
)
@click.option(
    "--camera",
    "cameras",
    multiple=True,
    metavar="NAME=SOURCE",
    help="A camera: a video device, a file or pipe played at its own pace, or lavfi:GRAPH. "
    "Repeat for several.",
)
@click.option(
    "--rig",
    type=ANY_PATH,
    metavar="DRIVE",
    help="An earlier drive (or its drive.toml) of this car: axes, lever arms, cameras, site.",
)
@click.option(
    "--rate",
    "rate_hz",
    type=Finite(0.1, 50),
    metavar="HZ",
    help="Set the receiver (u-blox) to this many fixes a second.",
)
@click.option("--raw", is_flag=True, help="Set it to send raw data (RXM-RAWX) too.")
@click.option("--pvt", is_flag=True, help="Set it to send NAV-PVT; implied by the other settings.")
@click.option(
    "--gnss-baud",
    type=click.IntRange(4800, 921600),
    metavar="BAUD",
    help="Set its line to this rate.",
)
@click.option("--restore", is_flag=True, help="Undo the settings at the end of the recording.")
@click.option(
    "--duration",
    "duration_s",
    type=Finite(0.1),
    metavar="S",
    help="End after so many seconds.",
)
@click.option("--plain", is_flag=True, help="Lines instead of the live panel.")
@click.option("--list-ports", is_flag=True, help="Show the ports and what is heard on them.")
@click.option(
    "--restore-receiver",
    type=ANY_PATH,
    metavar="DRIVE",
    help="Undo the settings that the recording of DRIVE made, after a crash of it.",
)
@click.option(
    "--replay",
    type=ANY_PATH,
    metavar="DRIVE",
    help="Play a drive's bytes into pseudo-terminals, for a recorder to record.",
)
@click.option(
    "--links",
    type=ANY_PATH,
    metavar="DIR",
    help="With --replay: where the terminals appear, as DIR/gnss and DIR/imu.",
)
@click.option(
    "--speed",
    type=Finite(0.01, 1000),
    default=1.0,
    metavar="X",
    help="With --replay: so many times as fast.",
)
@click.option(
    "--line-baud",
    type=click.IntRange(1200, 12_000_000),
    default=460_800,
    metavar="BAUD",
    help="With --replay: pace of the bytes. Default: 460800.",
)
@click.option(
    "--feed-log",
    is_flag=True,
    help="With --replay: write DIR/*_feed.csv, which byte was sent when.",
)
@click.option(
    "--time-scale",
    type=Finite(0.01, 1000),
    default=1.0,
    metavar="X",
    help="Record a replay of --speed X: the host's clock is taken X times as fast.",
)
def command(
    list_ports: bool,
    restore_receiver: Path | None,
    replay: Path | None,
    links: Path | None,
    speed: float,
    line_baud: int,
    feed_log: bool,
    cameras: tuple[str, ...],
    **options: Any,
) -> int:
    """Record receiver, inertial sensor and cameras into a drive folder."""
    from automap.errors import ConfigError

    if list_ports:
        from pipeline.record.devices import port_lines

        for line in port_lines():
            click.echo(line)
        return 0
    if restore_receiver is not None:
        from pipeline.record.restore_receiver import restore_receiver as restore

        failed = restore(restore_receiver)
        for text in failed:
            click.echo(f"warning: {text}", err=True)
        click.echo("the receiver is as before" if not failed else "restored in part")
        return 4 if failed else 0
    if replay is not None:
        if links is None:
            raise ConfigError("--replay needs --links DIR, where its terminals are to appear.")
        from pipeline.record.play_drive import ReplayRequest, play_drive

        for line in play_drive(ReplayRequest(replay, links, speed, line_baud, feed_log)):
            click.echo(line)
        return 0
    return _record(cameras, options)


def _record(cameras: tuple[str, ...], options: dict[str, Any]) -> int:
    from pipeline.check.command import check_drive
    from pipeline.record.command import record
    from pipeline.record.request import RecordRequest

    ending, cut_short = record(RecordRequest(cameras=cameras, **options))
    for text in list(dict.fromkeys(ending.warnings))[:_SHOWN]:
        click.echo(f"warning: {text}", err=True)
    frames = "".join(f", {count} frames of {name}" for name, count in ending.frames.items())
    click.echo(
        f"{ending.seconds:.0f} s, {ending.epochs} epochs, {ending.samples} samples{frames}, "
        f"{len(ending.warnings)} warnings (recording.log)"
    )
    click.echo(str(ending.folder))
    for text in check_drive(ending.folder).wrong():
        click.echo(text, err=True)
    if cut_short:
        return 130
    return 3 if ending.empty else 0
