"""How to get from satellite coordinates to a national system, by published operations only.

Directly where PROJ knows an operation that is good enough. Else, in Europe, in two steps: its
systems are realisations of ETRS89, or EPSG has operations between it and them. What is refused is
PROJ's habit of taking "no shift at all, good to 3 m" for an operation.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from automap.errors import ConfigError, InputError
from automap.io.vector_layer import parse_crs
from automap.records import FloatArray

LEAST_ACCURACY_M = 0.25
"""Operations that are not at least this good are no transformation of a sign's position."""
REALISATION_M = 0.1
"""A frame and its realisation may be the same numbers where EPSG says that this is so good: what
national networks and ETRS89 agree to."""
HUB = "EPSG:4937"
"""ETRS89, the frame that Europe's countries tie their systems to."""

Bounds = tuple[float, float, float, float]


@dataclass(frozen=True)
class Route:
    """Operations one after another, PROJ's ``description`` of them, and the sum ``accuracy_m`` of
    what they are good to."""

    steps: tuple[Any, ...]
    description: str
    accuracy_m: float

    def transform(
        self, lon: FloatArray, lat: FloatArray, height: FloatArray, year: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Coordinates [n] of the ``year`` in the target: degrees, metres."""
        epoch = np.full(len(lon), year)
        for step in self.steps:
            lon, lat, height = step.transform(lon, lat, height, epoch)[:3]
        return lon, lat, height


def find_crs(code: str, option: str = "--datum") -> Any:
    """The system of a code; ConfigError, in the name of ``option``, where there is none."""
    try:
        return parse_crs(code)
    except ValueError:
        raise ConfigError(
            f"{option} {code}: PROJ knows no such code; look it up in EPSG."
        ) from None


def area_missed(code: str, lon: FloatArray, lat: FloatArray) -> str:
    """The area that a system is made for, in words, where positions [n] in degrees lie outside of
    it by more than half a degree; "" where all lie inside."""
    area = find_crs(code).area_of_use
    if area is None:
        return ""
    slack = 0.5
    if area.west <= area.east:
        inside = (lon >= area.west - slack) & (lon <= area.east + slack)
    else:
        inside = (lon >= area.west - slack) | (lon <= area.east + slack)
    inside &= (lat >= area.south - slack) & (lat <= area.north + slack)
    name = str(area.name)
    short = name if len(name) <= 80 else name[:77] + "..."
    return "" if inside.all() else short


def route(source: str, target: str, option: str, bounds: Bounds) -> Route:
    """The way from one system to another; ``bounds`` are west, south, east, north in degrees.

    Raises InputError, in the name of ``option``, where there is none that is good enough, with the
    grid that is missing.
    """
    try:
        step, accuracy = operation(source, target, option, bounds)
        return Route((step,), str(step.description), accuracy)
    except InputError as refused:
        outside = area_missed(HUB, np.array(bounds[::2]), np.array(bounds[1::2]))
        if target == HUB or outside or "the grid" in str(refused):
            raise
    first, good = operation(source, HUB, option, bounds)
    second, more = operation(HUB, target, option, bounds, LEAST_ACCURACY_M - good, True)
    told = f"{first.description}, then {second.description}"
    return Route((first, second), told, good + more)


@lru_cache(maxsize=16)
def operation(
    source: str,
    target: str,
    option: str,
    bounds: Bounds,
    least: float = LEAST_ACCURACY_M,
    realised: bool = False,
) -> tuple[Any, float]:
    """The best single operation that is a real one and good to ``least`` m, and its accuracy.

    ``realised``: the target may be a realisation of the source, which PROJ takes for the same.
    Raises as ``route``.
    """
    from pyproj.aoi import AreaOfInterest
    from pyproj.transformer import TransformerGroup

    try:
        with warnings.catch_warnings():
            # missing grids are told below, in a sentence of our own
            warnings.simplefilter("ignore", UserWarning)
            group = TransformerGroup(
                source,
                target,
                always_xy=True,
                allow_ballpark=False,
                area_of_interest=AreaOfInterest(*bounds),  # type: ignore[arg-type]
            )
            known, lacking = group.transformers, group.unavailable_operations
    except IndexError:
        # pyproj stumbles over an empty list of operations
        known, lacking = [], []
    refused = ""
    for transformer in known:
        # PROJ says 0 for operations that define a frame and -1 where nothing is known
        accuracy = float(transformer.accuracy)
        null = transformer.definition.startswith("proj=noop")
        same = null and not (realised and 0.0 <= accuracy <= REALISATION_M)
        if same or not 0.0 <= accuracy <= least:
            how = "takes both for the same" if null else "is a rough one"
            good = f"good to {accuracy:.2g} m" if accuracy >= 0 else "of unknown accuracy"
            refused = refused or f"the one there is {how} ({good})"
            continue
        return transformer, accuracy
    grids = [
        (o.accuracy < 0.0, not grid.short_name.endswith((".tif", ".json")), o.accuracy,
         grid.short_name)
        for o in lacking
        for grid in o.grids
        if not grid.available and grid.short_name and o.accuracy <= least
    ]  # fmt: skip
    if grids:
        # projsync has grids of its own form only
        grid = min(grids)[-1]
        raise InputError(
            f"{option}: the transformation needs the grid {grid}, which PROJ does not "
            f"have here; fetch it with: projsync --file {grid}"
        )
    raise InputError(
        f"{option}: no transformation from satellite coordinates is good to "
        f"{LEAST_ACCURACY_M:g} m; {refused or 'PROJ has none'}. Take --crs {_zone(bounds)} "
        "(WGS 84) and transform it with the country's own service."
    )


def _zone(bounds: Bounds) -> str:
    """Code of the UTM zone of WGS 84 that the middle lies in."""
    zone = int((0.5 * (bounds[0] + bounds[2]) + 180.0) // 6.0) % 60 + 1
    return f"EPSG:{326 if bounds[1] + bounds[3] >= 0.0 else 327}{zone:02d}"
