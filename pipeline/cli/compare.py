"""``automap compare``."""

from __future__ import annotations

from pathlib import Path

import click

from pipeline.cli.command import Command
from pipeline.cli.options import ANY_PATH

_EPILOG = """\b
Examples:
  automap compare city register.gpkg -o differences
  automap compare city signs.csv -o differences \\
    --columns class=VZ_NR,id=NR,x=RW,y=HW --crs EPSG:25832
"""


@click.command(
    "compare", cls=Command, epilog=_EPILOG, short_help="Compare a map with an inventory of signs."
)
@click.argument("folder", metavar="MAP", type=ANY_PATH)
@click.argument("inventory", metavar="INVENTORY", type=ANY_PATH)
@click.option(
    "-o",
    "--out",
    required=True,
    metavar="DIR",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of the comparison.",
)
@click.option(
    "--columns",
    metavar="ROLE=COLUMN,...",
    help="Which columns hold what: id, class, lat, lon, x, y, facing, sd, value, status. "
    "Default: by their names.",
)
@click.option("--crs", metavar="CRS", help="Coordinate system, where the inventory states none.")
@click.option("--layer", metavar="NAME", help="Layer of a file that has several.")
@click.option("--country", metavar="CC", help="Whose catalogue its codes are of: DE, AU, US ...")
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
@click.option("--json", "as_json", is_flag=True, help="Print comparison.json.")
def command(
    folder: Path,
    inventory: Path,
    out: Path,
    columns: str | None,
    crs: str | None,
    layer: str | None,
    country: str | None,
    quiet: bool,
    as_json: bool,
) -> None:
    """Compare the map in MAP with an inventory of signs.

    The inventory is a GeoPackage, GeoJSON, Shapefile, Parquet or CSV file of points. Each sign
    of either is matched, moved, of another class, new, missing, unconfirmed or not seen, with a
    probability, by the errors that the map states and the inventory turns out to have. The
    likeliest of a kind, of which nine of ten are expected to be right, are for work (missing ones
    each with that probability); the others are listed by themselves, as unsure.
    """
    from automap.export.inventory import WORK
    from automap.io.csv_columns import listed
    from pipeline.compare.command import columns_of, compare_with_inventory, summary_text

    result = compare_with_inventory(
        folder, inventory, out, columns_of(columns), crs, layer, country
    )
    for text in result.warnings:
        click.echo(click.style("warning: ", fg="yellow") + text, err=True)
    if as_json:
        click.echo(summary_text(result.summary))
    elif not quiet:
        kinds = result.summary["kinds"]
        click.echo(f"{result.summary['signs']} signs, {result.summary['listed']} listed -> {out}")
        read = [f"{role} is {name}" for role, name in result.summary["columns"].items()]
        unread = tuple(result.summary["columns_not_used"])
        read += [f"not used: {listed(unread)}"] if unread else []
        click.echo(f"  columns      {', '.join(read)}")
        for kind, number in kinds.items():
            unsure = number - result.summary["sure"][kind]
            beside = f" ({unsure} unsure)" if unsure and kind in WORK else ""
            click.echo(f"  {kind.replace('_', ' '):12} {number}{beside}")
