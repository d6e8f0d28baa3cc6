"""The background of the viewer's map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from automap.errors import AutoMapError
from automap.io.background import check_below, open_background
from pipeline.shared.background import background_file

if TYPE_CHECKING:
    from automap.io.web_tiles import Bounds
    from pipeline.view.viewed_map import ViewedMap


_ASKED = 60
"""Drives of a merged map that are asked for a background: as many as have their paths drawn."""


def lay_below(shown: ViewedMap, stated: Path | None) -> None:
    """Give the map the background ``stated``, else that of its first drive that names one.

    Raises InputError where the stated one cannot be shown; of a drive's own it is noted.
    """
    if stated is not None:
        shown.background = open_background(stated)
        check_below(shown.background, _map_box(shown), stated)
        return
    for drive in shown.drives[:_ASKED]:
        if drive.drive is None or not drive.drive.manifest.site.background:
            continue
        try:
            file = background_file(drive.drive)
            assert file is not None
            background = open_background(file)
            check_below(background, _map_box(shown), file)
        except AutoMapError as error:
            shown.problems.append(f"The map has no background: {error}")
            continue
        shown.background = background
        return


def _map_box(shown: ViewedMap) -> Bounds | None:
    """Where the map lies, by its signs, and by the path of a single drive."""
    lon, lat = shown.table.lon_deg, shown.table.lat_deg
    trajectory = None if shown.merged else shown.drives[0].trajectory
    if trajectory is not None:
        lon = np.concatenate([lon, np.degrees(trajectory.lon_rad)])
        lat = np.concatenate([lat, np.degrees(trajectory.lat_rad)])
    known = np.isfinite(lon) & np.isfinite(lat)
    lon, lat = lon[known], lat[known]
    if not len(lon):
        return None
    return float(lon.min()), float(lat.min()), float(lon.max()), float(lat.max())
