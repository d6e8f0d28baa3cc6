"""The kinds of recordings that can be imported; light, so that help costs nothing."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click


@dataclass(frozen=True)
class Option:
    """An option of one kind: ``flag`` as typed, the rest as click takes it."""

    flag: str
    help: str
    settings: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Kind:
    """A kind: where its function ``(source, out, **options) -> warnings`` is, what it reads and
    what it was tested on."""

    name: str
    function: str
    source: str
    summary: str
    text: str
    options: tuple[Option, ...] = ()


KINDS: dict[str, Kind] = {
    kind.name: kind
    for kind in (
        Kind(
            "comma2k19",
            "pipeline.importers.comma2k19:import_comma2k19",
            "SEGMENT",
            "A segment of comma2k19.",
            """SEGMENT is the folder that holds processed_log and global_pose.

            IMU, live positions, the car's speed, the video where it is there, and the reference
            poses as truth. Tested on a segment of the data set.""",
        ),
        Kind(
            "bearings",
            "pipeline.importers.bearings:import_bearings",
            "CSV",
            "Finished sightings: camera position, bearing, perhaps depth.",
            """CSV is a table with columns for latitude, longitude and bearing (degrees clockwise
            from north) of each sighting, and perhaps depth in metres, class and sd of the bearing
            in degrees; the usual other names (lat, lng, azimuth, distance) are understood.

            Tested on the sightings of Krylov, Kenny and Dahyot's street objects.""",
            (
                Option(
                    "--truth",
                    "Known positions, CSV or GeoJSON, for automap evaluate.",
                    {"type": click.Path(path_type=Path)},
                ),
                Option(
                    "--truth-sd",
                    "Their own error in metres, one sigma.",
                    {"type": click.FloatRange(min=0), "default": 0.0},
                ),
            ),
        ),
    )
}
