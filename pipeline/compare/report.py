"""The page of a comparison: how many of each kind, and what to look at, with pictures."""

from __future__ import annotations

import base64
import math
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from automap import __version__
from automap.export.beliefs import belief_text
from automap.export.icons import class_icon, words_apart
from automap.export.inventory import WORK
from automap.inventory.limits import SURE
from pipeline.pages.render import render
from pipeline.pages.section import Figure
from pipeline.shared.pictures import pictures_by_sign, read_pictures

if TYPE_CHECKING:
    from automap.export.inventory import ComparedSign
    from pipeline.shared.products import RunProducts

_TITLES = {
    "missing": (
        "Missing",
        "In the inventory, in view of drives, and found by none: gone, or hidden from all of them "
        "by something that stays (a tree, a hoarding), which more drives do not tell apart.",
    ),
    "new": ("New", "On the map and not in the inventory."),
    "class": ("Another class", "One sign, of which map and inventory say different things."),
    "moved": (
        "Moved",
        "Found so far from where it is listed, that way, which is more than errors explain.",
    ),
    "unsure": (
        "Unsure",
        "May be one of these, but with them fewer than nine of ten would be right, as where "
        "something may hide what was not found, or a warning says why the inventory may be read "
        "wrong: where there is time, or after another drive.",
    ),
    "unconfirmed": (
        "Unconfirmed",
        "In view and not found, but a sign that stands is overlooked as often. Where a number of "
        "more drives stands, so many past it that do not find it either would tell that it is "
        "gone.",
    ),
    "not_seen": ("Not seen", "No drive had them in view: nothing is said of them."),
}
_POINTS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")
_MOST = 400
"""Rows of a kind on the page; all are in comparison.csv."""


def comparison_report(
    name: str,
    rows: Sequence[ComparedSign],
    summary: dict[str, Any],
    products: RunProducts,
    warnings: Sequence[str],
) -> str:
    """The page; ``summary`` is the content of comparison.json."""
    pictures = {
        sign: f"data:image/jpeg;base64,{base64.b64encode(views[0].jpeg).decode()}"
        for sign, views in pictures_by_sign(read_pictures(products)).items()
    }
    # a name that the map itself doubts is to be looked at, whatever the row is about
    doubted = {
        s.id: f"(named with {s.class_probability:.2f})"
        for s in products.signs or []
        if s.class_probability < SURE
    }
    words = words_apart({name for r in rows for name in (r.class_name, r.listed_class)})
    parts = []
    for kind, (title, meaning) in _TITLES.items():
        own = sorted((r for r in rows if _part(r) == kind), key=lambda r: -r.probability)
        if own:
            shown = [_entry(row, words, pictures, doubted) for row in own[:_MOST]]
            parts.append({"title": title, "meaning": meaning, "n": len(own), "rows": shown})
    kinds = Counter(_part(row) for row in rows)
    shift = summary["inventory_shift_m"]
    figures = [Figure(str(kinds["matched"]), "matched", f"of {summary['listed']} listed")]
    figures += [Figure(str(kinds[kind]), title.lower(), "") for kind, (title, _) in _TITLES.items()]
    stated = summary["inventory_sd_stated_m"]
    sd, how = (summary["inventory_sd_m"], "estimated") if stated is None else (stated, "as stated")
    figures.append(Figure(f"{sd:.2f} m", "sd of the inventory", f"per axis, {how}"))
    facts = [
        ("version", __version__),
        ("inventory", summary["inventory"]),
        ("columns", ", ".join(f"{role}: {name}" for role, name in summary["columns"].items())),
        ("shift of the inventory", f"{shift['e']:+.2f} m east, {shift['n']:+.2f} m north"),
        ("signs in view that were found", f"{100 * summary['detection_rate']:.0f} %"),
    ]
    return render(
        "comparison.html.j2", title="Comparison", name=name, figures=figures, parts=parts,
        warnings=warnings, facts=facts,
    )  # fmt: skip


def _part(row: ComparedSign) -> str:
    """Which part of the page a row belongs to."""
    return row.kind if row.is_sure or row.kind not in WORK else "unsure"


def _entry(
    row: ComparedSign, words: dict[str, str], pictures: dict[str, str], doubted: dict[str, str]
) -> dict[str, str]:
    lon, lat = row.place
    kind = _TITLES[row.kind][0].lower() if _part(row) == "unsure" else ""
    shown = row.class_name or row.listed_class
    icon = base64.b64encode(class_icon(shown)).decode() if shown else ""
    more = row.kind == "unconfirmed" and row.more_drives > 0
    distance = f"{row.distance_m:.1f} ± {row.sd_m:.1f}" if row.kind in ("moved", "class") else ""
    if row.kind == "moved":
        distance += (
            f" {_POINTS[round(math.degrees(math.atan2(row.east_m, row.north_m)) / 45.0) % 8]}"
        )
    listed = words.get(row.listed_class, "")
    # of what nobody saw there is no probability
    belief = "" if row.kind == "not_seen" else belief_text(row.probability)
    return {
        "icon": f"data:image/png;base64,{icon}" if icon else "",
        "picture": pictures.get(row.id, ""),
        "id": row.id,
        "listed_id": row.listed_id,
        # who keeps the list thinks in its codes
        "code": row.code,
        "listed_code": "" if row.listed_code in (row.listed_class, listed) else row.listed_code,
        "words": " ".join([words.get(row.class_name, ""), doubted.get(row.id, "")]).strip(),
        "listed_words": listed,
        "probability": f"{kind} {belief}".strip()
        + (f", {row.more_drives:.0f} more drives" if more else ""),
        "distance": distance,
        "place": f"{lat:.6f}, {lon:.6f}",
    }
