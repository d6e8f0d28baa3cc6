"""What ``automap merge`` prints: the map in a few lines and a table of changes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from automap.export.uncertainty import ce95
from automap.mapping.limits import TELLING_DRIVES
from pipeline.merge.report import change_row

if TYPE_CHECKING:
    from pipeline.merge.outcome import MergeOutcome

_CHANGES = 40
_DRIVES = 20


def summary_lines(outcome: MergeOutcome) -> list[str]:
    """The lines, without the warnings."""
    merged, signs = outcome.merged, outcome.signs
    told = outcome.summary
    left_out = told["unlikely_signs"] + told["rejected_signs"]
    drives = "drive" if len(merged.drives) == 1 else "drives"
    lines = [
        f"{len(merged.drives)} {drives}, {len(merged.sightings)} sightings -> {outcome.folder} "
        f"in {outcome.seconds:.1f} s",
        f"  signs       {told['signs']}, {left_out} unlikely or rejected ones left out",
    ]
    if signs:
        cov = np.array([s.cov_enu for s in signs])
        radius = np.median(ce95(cov[:, 0, 0], cov[:, 0, 1], cov[:, 1, 1]))
        several = sum(len(s.drives) > 1 for s in signs)
        by_several = f"; {several} signs seen by several drives"
        lines.append(
            f"  uncertainty 95 % radius {radius:.2f} m (median)"
            + (by_several if len(merged.drives) > 1 else "")
        )
        # of one drive nothing tells what it did not see, and of two it is why a sign is known
        if len(merged.drives) >= TELLING_DRIVES:
            lines.append(
                f"  detection   {100 * merged.rates.overall:.0f} % of the signs in view are seen"
            )
    for number, drive in enumerate(merged.drives[:_DRIVES]):
        offset, sd = merged.adjusted.drive_offset[number], merged.adjusted.drive_sd[number]
        # of a drive without a trajectory nothing tells what its signs share
        if sd[0] > 0.0:
            offset = np.round(offset, 2) + 0.0
            lines.append(
                f"  offset      {drive.name:<24} east {offset[0]:+.2f} ± {sd[0]:.2f} m, north "
                f"{offset[1]:+.2f} ± {sd[1]:.2f} m"
            )
    if len(merged.drives) > _DRIVES:
        lines.append("  offset      the other drives' are in merge.json")
    found = outcome.comparison
    if found is not None:
        kinds = [change.kind for change in found.changes]
        counted = ", ".join(
            f"{kinds.count(kind)} {text}"
            for kind, text in (
                ("new", "new"), ("gone", "gone"), ("class", "of another class"), ("moved", "moved")
            )
        )  # fmt: skip
        lines.append(
            f"  changes     {counted}; {found.unchanged} as before, {found.unvisited} not passed "
            "again"
        )
        for change in found.changes[:_CHANGES]:
            kind, name, sign_class, before, belief, note = change_row(change)
            was = f" (was {before})" if before else ""
            lines.append(f"    {kind:<14}{name:<11}{sign_class}{was}  {belief}  {note}".rstrip())
        if len(found.changes) > _CHANGES:
            lines.append(f"    and {len(found.changes) - _CHANGES} more in changes.geojson")
    lines.append(f"  map         {outcome.folder / 'report.html'}  {outcome.folder / 'map.kml'}")
    return lines
