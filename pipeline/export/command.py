"""``automap export``: a finished run in one format."""

from __future__ import annotations

from pathlib import Path

from automap.errors import ConfigError, InputError
from automap.io import names
from pipeline.export.content import map_content, refuse_lost_signs, trajectory_of
from pipeline.export.datum import check_format, in_datum
from pipeline.export.formats import FORMATS, TRAJECTORY_FORMATS, write_dictionary
from pipeline.export.projected import check_projected, in_projection
from pipeline.export.roads import put_on_roads
from pipeline.export.trajectory_view import TrajectoryView, viewed
from pipeline.shared.run_record import drive_of, results_of
from pipeline.shared.targets import spare_recordings, spare_results

_NAME_PICTURES = ("geojson", "gpkg", "parquet", "flatgeobuf", "csv", "shapefile")
"""Formats that name the pictures of signs as files beside them; others hold them, or have none."""


def export_run(
    out: Path,
    fmt: str,
    target: Path | None = None,
    view: TrajectoryView | None = None,
    min_confidence: float = 0.0,
    datum: str = "",
    roads: Path | None = None,
    crs: str = "",
    heights: str = "",
) -> tuple[Path, list[str]]:
    """Write the map of a finished run in one format, and the data dictionary beside it.

    ``target`` is the file to write, by default the format's own name in OUT; ``view`` which
    trajectory, for the formats of one; ``min_confidence`` leaves out signs less sure;
    ``datum`` such as GDA2020@2026.5 moves the positions of GIS formats into it; ``roads`` is a
    layer on which the signs get a place, in place of the map's own; ``crs`` such as EPSG:25832
    projects positions, with ``heights`` such as EPSG:7837. Returns the file and the warnings.
    Raises ConfigError for an unknown format or a view of signs, InputError when OUT holds no
    run, or has lost the signs that its run located.
    """
    view = TrajectoryView() if view is None else view
    if fmt not in FORMATS:
        known = ", ".join((*FORMATS, "postgis"))
        raise ConfigError(f"there is no format {fmt!r}; choose one of {known}.")
    if not view.is_plain and fmt not in TRAJECTORY_FORMATS:
        raise ConfigError(
            f"--at, --point and --filtered choose a trajectory, and {fmt} is a format of signs; "
            f"take one of {', '.join(TRAJECTORY_FORMATS)}."
        )
    check_format(datum, fmt)
    check_projected(crs, heights, datum, fmt)
    out = results_of(out)
    check_run(out)
    file_name, write = FORMATS[fmt]
    path = target if target is not None else out / file_name
    if path.is_dir():
        raise ConfigError(f"-o {path} is a folder; name a file, as {path / file_name}.")
    _check_suffix(path, fmt)
    spare_results(path, out, file_name)
    spare_recordings(path, *([] if view.at is None else [view.at]))
    if path.name == names.DICTIONARY:
        raise ConfigError(f"{path} is where the meaning of the columns goes; name another file.")
    content = map_content(out, drive_of(out)[0], min_confidence, roads is None)
    if fmt not in TRAJECTORY_FORMATS:
        refuse_lost_signs(content)
    if not view.is_plain:
        content.products.trajectory = viewed(out, trajectory_of(content), view)
        content.every_row = view.at is not None
    if roads is not None:
        put_on_roads(content, roads)
    if crs:
        content = in_projection(content, crs, heights, datum)
    elif datum:
        content = in_datum(content, datum)
    write(content, path)
    beside = path.parent / names.PICTURES
    if content.pictures and fmt in _NAME_PICTURES and not beside.is_dir():
        # "to .." would be the folder above
        there = "this folder" if path.parent == Path() else path.parent
        content.warnings.append(
            f"{path} names the pictures of its signs as files of {names.PICTURES} beside it; copy "
            f"the folder {out / names.PICTURES} to {there}."
        )
    write_dictionary(path.with_name(names.DICTIONARY))
    if fmt in TRAJECTORY_FORMATS:
        # that there are no signs concerns no trajectory
        return path, list(content.products.problems)
    return path, content.warnings


def _check_suffix(path: Path, fmt: str) -> None:
    """Raise ConfigError where a file would bear the name of another format: no program opens it."""
    suffixes = {name: Path(file).suffix for name, (file, _) in FORMATS.items()}
    own = suffixes.pop(fmt)
    if path.suffix.lower() in {*suffixes.values(), ".shp"} - {own}:
        raise ConfigError(
            f"{path} has the name of another format than {fmt}; give it the ending {own}."
        )


def check_run(out: Path) -> None:
    """Raise InputError when OUT holds no run."""
    if not out.is_dir():
        raise InputError(f"{out} is no output folder of automap run; run the drive first.")
    has_run = (names.RUN, names.TRAJECTORY, names.SIGNS_RAW)
    if not any((out / name).is_file() for name in has_run):
        raise InputError(f"{out} holds neither a trajectory nor signs; run the drive first.")
