"""``automap run``."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click

from pipeline.cli.command import Command, debug_wanted, show_failure
from pipeline.cli.options import ANY_PATH, settings_options
from pipeline.run.registry import ORDER

_EPILOG = """\b
Examples:
  automap run data/sample-drive
  automap run drives/* -o maps --set detect.min_score=0.4
  automap run data/sample-drive --from geolocate --dry-run
"""


@click.command("run", cls=Command, epilog=_EPILOG, short_help="Make the map of one or more drives.")
@click.argument("drives", nargs=-1, required=True, metavar="DRIVE...", type=ANY_PATH)
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help="Output folder; with several drives it receives one folder each. Default: DRIVE/_automap.",
)
@settings_options()
@click.option("--only", type=click.Choice(ORDER), help="Look at this stage alone.")
@click.option("--from", "first", type=click.Choice(ORDER), help="Start with this stage.")
@click.option("--to", "last", type=click.Choice(ORDER), help="End with this stage.")
@click.option("--force", is_flag=True, help="Run the stages even where nothing has changed.")
@click.option("--dry-run", is_flag=True, help="Say which stages would run and why; run none.")
@click.option(
    "--tune", is_flag=True, help="Find the noise levels of the fusion by likelihood, finely."
)
@click.option(
    "--datum",
    metavar="D",
    help="Datum of GeoPackage and Parquet, as GDA2020@2026.5. Default: WGS-84.",
)
@click.option(
    "--roads",
    metavar="FILE",
    type=ANY_PATH,
    help="Lines of roads (GeoPackage, GeoJSON, Shapefile, Parquet, .osm, .osm.pbf): signs get "
    "road, chainage and side.",
)
@click.option(
    "--background",
    metavar="FILE",
    type=ANY_PATH,
    help="What lies below the report's map: PMTiles, MBTiles, GeoTIFF, GeoPackage, or lines.",
)
@click.option(
    "--jobs",
    metavar="N",
    type=click.IntRange(1, 256),
    default=1,
    help="Run so many drives at once, each in a process of its own; each needs the memory of a "
    "run. Default: 1.",
)
@click.option(
    "--strict",
    is_flag=True,
    help="Exit with code 5 where the verdict on a path or on its signs is not good.",
)
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object at the end.")
def command(
    drives: tuple[Path, ...],
    out: Path | None,
    config: Path | None,
    assignments: tuple[str, ...],
    only: str | None,
    first: str | None,
    last: str | None,
    force: bool,
    dry_run: bool,
    tune: bool,
    datum: str | None,
    roads: Path | None,
    background: Path | None,
    jobs: int,
    strict: bool,
    quiet: bool,
    as_json: bool,
) -> int:
    """Make the map of one or more drives.

    Runs the stages ingest, sync, fuse, detect, geolocate, export and report. A stage whose
    inputs and settings have not changed since the last run is kept; why another one runs is
    said beside it. At the end stands whether the path may be relied on: good, doubtful or
    unusable, with the reasons; and whether the signs may.
    """
    from functools import partial

    from automap.errors import ConfigError, RegressionError
    from pipeline.run.batch import requested, run_drives
    from pipeline.shared.progress import Reporter
    from pipeline.shared.summary import as_dict
    from pipeline.shared.terminal import Terminal
    from pipeline.shared.verdicts import doubted

    if datum:
        assignments = (*assignments, f"export.datum={datum}")
    for option, file, key in (
        ("--roads", roads, "export.roads"),
        ("--background", background, "report.background"),
    ):
        if file is None:
            continue
        if not file.is_file():
            raise ConfigError(f"{option} {file}: no such file.")
        # a whole path, as TOML: run from elsewhere it is the same file
        assignments = (*assignments, f"{key}={json.dumps(str(file.resolve()))}")
    if tune:
        assignments = (*assignments, "fuse.tune=true")
    make = partial(
        requested,
        config,
        assignments,
        (only, first, last),
        force=force,
        dry_run=dry_run,
        command=("automap", *sys.argv[1:]),
    )
    request = make()
    reporter = Reporter() if quiet or as_json else Terminal(len(request.selected))
    outcomes = run_drives(drives, out, request, reporter, jobs, make)
    for outcome in outcomes:
        if outcome.error is not None:
            show_failure(outcome.error, debug_wanted())
    code = max(outcome.exit_code for outcome in outcomes)
    for outcome in outcomes if strict and not dry_run else ():
        for told in doubted(outcome.record) if outcome.error is None else ():
            failure = RegressionError(f"{outcome.drive}: {told.sentence()}")
            show_failure(failure, debug_wanted())
            code = max(code, failure.exit_code)
    if as_json:
        summary = {"exit_code": code, "drives": [as_dict(outcome) for outcome in outcomes]}
        click.echo(json.dumps(summary, indent=1, ensure_ascii=False))
    return code
