"""``automap export``."""

from __future__ import annotations

from pathlib import Path

import click

from pipeline.cli.command import Command

_EPILOG = """\b
Examples:
  automap export data/sample-drive/_automap --format csv
  automap export maps --format tum --point antenna
  automap export maps --format trajectory-csv --at frames.csv --point front -o frames_poses.csv
  automap export maps --format pos --filtered -o forward.pos
"""


@click.command("export", cls=Command, epilog=_EPILOG, short_help="Write a map in another format.")
@click.argument("out", type=click.Path(path_type=Path))
@click.option(
    "--format",
    "form",
    required=True,
    metavar="F",
    help="Signs: geojson, kml, gpkg, parquet, flatgeobuf, csv. "
    "Trajectory: trajectory-csv, pos, tum, kitti, gpx.",
)
@click.option(
    "-o",
    "--output",
    "target",
    type=click.Path(path_type=Path),
    help="File to write. Default: the format's own name in OUT.",
)
@click.option(
    "--at",
    type=click.Path(path_type=Path),
    metavar="TIMES.csv",
    help="Instants of the trajectory, in a column t_ns (stamps as in trajectory.parquet) or "
    "gps_s. Default: every row of the IMU.",
)
@click.option(
    "--point",
    default="imu",
    metavar="P",
    help="Point of the vehicle: imu, antenna, a camera's name, or x,y,z in metres forward, right, "
    "down of the IMU. Default: imu.",
)
@click.option("--filtered", is_flag=True, help="The forward filter's trajectory, not smoothed.")
def command(
    out: Path, form: str, target: Path | None, at: Path | None, point: str, filtered: bool
) -> None:
    """Write the map in OUT, or its trajectory, in one more format."""
    from pipeline.export import export_run
    from pipeline.export_view import TrajectoryView

    path, warnings = export_run(out, form, target, TrajectoryView(at, point, filtered))
    for text in warnings:
        click.echo(f"warning: {text}", err=True)
    click.echo(str(path))
