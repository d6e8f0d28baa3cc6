"""Whether a receiver's heights are above the ellipsoid, by its separation of the geoid."""

from __future__ import annotations

from automap.evaluation.plausibility import Finding
from automap.geoid import GEOID_OFF_M, maybe_above_sea, separations, sign_turned
from automap.records import Fixes


def check(fixes: Fixes) -> list[Finding]:
    """An error where the separation that the receiver states is the geoid's, sign turned; a warning
    where it is stated as none and heights may be above either."""
    told = separations(fixes)
    if told is None:
        return []
    stated, there = told
    if sign_turned(stated, there):
        text = (
            f"the geoid is stated {stated:+.1f} m from the ellipsoid and is {there:+.0f} m there: "
            f"the separation has the wrong sign, so heights are off by some {2 * abs(there):.0f} m"
        )
        advice = (
            "turn the sign of the separation in what wrote the log: ellipsoid to geoid, up positive"
        )
        return [Finding("error", text, advice, "geoid_sign")]
    if abs(there) < GEOID_OFF_M or not maybe_above_sea(fixes, stated):
        return []
    return [
        Finding(
            "warning",
            f"no separation of the geoid is stated, and it is {there:+.0f} m there: heights "
            "are taken as above the ellipsoid, and are off by as much if they are above the sea, "
            "as they are said to be in GPX and GGA; the stated uncertainty includes it",
            "let the receiver send the separation with GGA, or NAV-PVT, or write it into the table",
            "height_surface",
        )
    ]
