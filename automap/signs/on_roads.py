"""Signs that cannot stand on a road of their kind: a shield of a road's number that was read as a
limit, a crossing for pedestrians on a motorway.

Only a hint for who looks at the map: layers of roads have mistakes, and work on a road brings signs
that are else not on it.
"""

from __future__ import annotations

import re

from automap.signs.national import bare_name, shown_value

MOTORWAYS = frozenset({"motorway", "autobahn", "freeway"})
"""Words of layers for a motorway; OpenStreetMap's and Geofabrik's is the first. Their links, where
there are crossings, are not among them."""
STREETS = frozenset({"residential", "living_street"})
"""Kinds of OpenStreetMap's of streets that houses stand on."""
SLOWEST_MOTORWAY_KM_H = 60.0
"""Slower vehicles may not be on a motorway (StVO, section 18 (1))."""
FASTEST_STREET_KM_H = 70.0
"""More is not allowed within towns (VwV-StVO on sign 274, no. XI)."""
KM_PER_MILE = 1.609344

_NOT_AT_LEVEL = re.compile(
    r"(?:stop|stop-ahead|yield|yield-ahead|give-way-at-roundabout|roundabout|crossroads|"
    r"priority-road|pedestrians?-crossing|pedestrians-only|bicycles?-crossing|bicycles?-lane|"
    r"bicycles-only|children|school-zone|rail\w*-crossing[\w-]*|domestic-animals)(?:--\w+)?"
)
"""A motorway does not cross at level with any road, railway, tramway track or footpath, and is not
for pedestrians, cyclists and animals (Vienna Convention on Road Traffic, articles 1 (j), 25)."""


def road_check(class_name: str, road_kind: str, country: str | None = None) -> str:
    """What is odd about a class on a road of a kind, in words; "" where nothing is."""
    kind = road_kind.strip().lower()
    shown = None if "end-of-" in class_name else shown_value(class_name, country)
    if shown is not None:
        value, unit = shown
        km_h = value * KM_PER_MILE if unit == "mph" else value
        if kind in MOTORWAYS and km_h < SLOWEST_MOTORWAY_KM_H:
            return f"a limit of {value:.0f} {unit} on a motorway"
        if kind in STREETS and km_h > FASTEST_STREET_KM_H:
            return f"a limit of {value:.0f} {unit} on a road of kind {kind}"
        return ""
    if kind in MOTORWAYS and _NOT_AT_LEVEL.fullmatch(bare_name(class_name).partition("--")[2]):
        return "a sign of crossings, or of those who may not be there, on a motorway"
    return ""
