"""``automap export``."""

from __future__ import annotations

from pathlib import Path

import click

from pipeline.cli.command import Command
from pipeline.cli.options import ANY_PATH, Finite

_EPILOG = """\b
Examples:
  automap export data/sample-drive/_automap --format csv
  automap export maps --format gpkg --datum GDA2020 -o signs-gda2020.gpkg
  automap export maps --format shapefile --crs EPSG:7856 -o mga56.zip
  automap export maps --format osm --min-confidence 0.6 -o review.osm
  automap export maps --format tum --point antenna
  automap export maps --format trajectory-csv --at frames.csv --point front \\
      -o frames_poses.csv
  automap export maps --format csv --roads extract.osm.pbf
  automap export maps --format postgis --to postgresql://gis@localhost/roads
  automap export maps --format pos --filtered -o forward.pos
"""


@click.command("export", cls=Command, epilog=_EPILOG, short_help="Write a map in another format.")
@click.argument("out", type=ANY_PATH)
@click.option(
    "--format",
    "form",
    required=True,
    metavar="F",
    help="Signs: geojson, kml, kmz, gpkg, parquet, flatgeobuf, csv, xlsx (with pictures), "
    "shapefile, pmtiles, assemblies (posts as GeoJSON), osm (a file for review in JOSM), "
    "postgis (with --to). Trajectory: trajectory-csv, pos, tum, kitti, gpx.",
)
@click.option(
    "-o",
    "--output",
    "target",
    type=ANY_PATH,
    help="File to write. Default: the format's own name in OUT.",
)
@click.option(
    "--to",
    default="",
    metavar="URL",
    help="For postgis: postgresql://user@host:port/database?schema=public. The password may stand "
    "in the variable PGPASSWORD.",
)
@click.option(
    "--at",
    type=ANY_PATH,
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
@click.option(
    "--min-confidence",
    type=Finite(0.0, 1.0),
    default=0.0,
    metavar="C",
    help="Leave out signs less sure than this, 0 to 1. Default: 0.",
)
@click.option(
    "--datum",
    default="",
    metavar="D",
    help="Datum of gpkg, parquet, flatgeobuf, csv, xlsx and shapefile, as GDA2020@2026.5: its "
    "name or EPSG code, and the year of the coordinates. Default: WGS-84; the drive's year.",
)
@click.option(
    "--roads",
    type=ANY_PATH,
    metavar="FILE",
    help="Lines of roads, as of automap run: signs get road, chainage and side.",
)
@click.option(
    "--crs",
    default="",
    metavar="EPSG:N",
    help="Projected coordinates in gpkg, shapefile, flatgeobuf and parquet, beside the degrees in "
    "csv, xlsx and postgis, as EPSG:25832; the datum is that of the system.",
)
@click.option(
    "--heights",
    default="",
    metavar="EPSG:N",
    help="With --crs: heights of this system, as EPSG:7837, by PROJ's grid of its geoid. Default: "
    "above the ellipsoid.",
)
@click.option("--filtered", is_flag=True, help="The forward filter's trajectory, not smoothed.")
def command(
    out: Path,
    form: str,
    target: Path | None,
    to: str,
    at: Path | None,
    point: str,
    min_confidence: float,
    datum: str,
    roads: Path | None,
    crs: str,
    heights: str,
    filtered: bool,
) -> None:
    """Write the map in OUT, or its trajectory, in one more format.

    The meaning of every column is written beside it, in data_dictionary.csv.
    """
    from pipeline.export.command import export_run
    from pipeline.export.trajectory_view import TrajectoryView

    if form == "postgis" or to:
        from pipeline.export.datum import check_format
        from pipeline.export.postgis import export_postgis

        check_format(datum, "postgis")
        told, warnings = export_postgis(out, form, to, min_confidence, roads, crs, heights)
        for text in warnings:
            click.echo(f"warning: {text}", err=True)
        click.echo(told)
        return
    path, warnings = export_run(
        out,
        form,
        target,
        TrajectoryView(at, point, filtered),
        min_confidence,
        datum,
        roads,
        crs,
        heights,
    )
    for text in warnings:
        click.echo(f"warning: {text}", err=True)
    click.echo(str(path))
