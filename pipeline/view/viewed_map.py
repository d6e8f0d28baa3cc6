"""A map as the page shows it: signs, drives, and the review as it stands."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from automap.errors import AutoMapError
from automap.export.clock import iso_texts, utc_of_stamps
from automap.export.fields import ROAD_FIELDS, SIGN_FIELDS
from automap.export.uncertainty import ce95
from automap.io import names
from automap.records import ClockModel, IntArray, PlacedSign
from pipeline.view.drives import MapDrive
from pipeline.view.payload import sign_payload
from pipeline.view.sign_roads import SignRoads, read_sign_roads
from pipeline.view.signs import SignTable, table_of
from pipeline.view.snapshot import Snapshot

if TYPE_CHECKING:
    from automap.io.web_tiles import Background


@dataclass(frozen=True, eq=False)
class Box:
    """A box of a sign: ``row`` among the boxes of ``drive``, the map's drive ``number``."""

    number: int
    drive: MapDrive
    row: int


@dataclass
class ViewedMap:
    """The map in ``out``. ``drives`` are in the order of their numbers on the page; ``reviewer`` is
    who reviews if the page does not say, ``problems`` what is not shown."""

    out: Path
    name: str
    merged: bool
    signs: SignTable | None
    drives: list[MapDrive]
    background: Background | None = None
    reviewer: str = ""
    problems: list[str] = field(default_factory=list)

    @cached_property
    def table(self) -> SignTable:
        """The map's own signs, none where it has no table of them."""
        return table_of([]) if self.signs is None else self.signs

    @cached_property
    def payload(self) -> bytes:
        """All signs for the page's map."""
        return b"" if self.signs is None else sign_payload(self.signs)

    def overview(self) -> dict[str, Any]:
        """What the page needs first; ``known`` are the classes that a sign may have, with their
        codes of all countries for a search."""
        from automap.signs.classes import load_classes
        from automap.signs.vocabulary import load_vocabulary

        classes = load_classes()
        known = sorted({*load_vocabulary().classes, *self.table.classes, *classes} - {""})
        codes = {
            name: ", ".join(f"{place} {code}" for place, code in sorted(entry.codes.items()))
            for name, entry in classes.items()
        }
        below = self.background
        return {
            "name": self.name,
            "merged": self.merged,
            "signs": len(self.table),
            "drives": [drive.name for drive in self.drives],
            "fields": [
                {"name": f.name, "title": f.title, "unit": f.unit_text, "meaning": f.meaning}
                for f in (*SIGN_FIELDS, *(ROAD_FIELDS if self._on_roads.rows else ()))
            ],
            "known": [{"name": name, "codes": codes.get(name, "")} for name in known],
            "report": (self.out / names.REPORT).is_file(),
            "reviewer": self.reviewer,
            "problems": list(self.problems),
            "background": None
            if below is None
            else {
                "name": below.name,
                "bounds": list(below.bounds),
                "least_zoom": below.least_zoom,
                "most_zoom": below.most_zoom,
                "tile_px": below.tile_px,
            },
        }

    def sign(self, row: int, now: Snapshot) -> dict[str, Any] | None:
        """All that is known about one sign, None for a row that is not there."""
        if not 0 <= row < len(self.table) + len(now.made):
            return None
        signs, k = self.at(row, now)
        views = [{"drive": b.number, **b.drive.view(b.row)} for b in self.boxes_of(row, now)]
        return {
            "id": signs.ids[k],
            "class": signs.class_of(k),
            "lon_deg": _number(signs.lon_deg[k], 7),
            "lat_deg": _number(signs.lat_deg[k], 7),
            "height_m": _number(signs.height_m[k], 2),
            "values": self._values(signs, k)
            | self._code_of(row, now)
            | self._road_of(signs.ids[k], row, now),
            "views": views + self._clicks(row, now),
        }

    def at(self, row: int, now: Snapshot) -> tuple[SignTable, int]:
        """The table that a row of the page is in, the map's or the review's, and where."""
        if row < len(self.table):
            return self.table, row
        assert now.table is not None
        return now.table, row - len(self.table)

    def class_of(self, row: int, now: Snapshot) -> str:
        """A sign's class after the review."""
        name = next((n for n, at in now.rows.items() if at == row), None)
        decided = None if name is None else now.state[name].class_name
        table, k = self.at(row, now)
        return decided or table.class_of(k)

    def placed(self, row: int, now: Snapshot) -> PlacedSign:
        """Where a sign stands; ValueError for one of unknown place."""
        signs, k = self.at(row, now)
        variances = tuple(float(c[k]) for c in (signs.cov_ee_m2, signs.cov_en_m2, signs.cov_nn_m2))
        place = float(signs.lon_deg[k]), float(signs.lat_deg[k])
        if not np.isfinite([*variances, *place]).all():
            raise ValueError("a sign without a known place cannot be made one with another")
        return PlacedSign(
            *place,
            (*variances, float(signs.sd_u_m[k]) ** 2),  # type: ignore[arg-type]
            height_m=float(signs.height_m[k]),
            height_above_road_m=float(signs.height_above_road_m[k]),
            sd_above_road_m=float(signs.sd_above_road_m[k]),
            facing_deg=float(signs.facing_deg[k]),
            facing_sd_deg=float(signs.facing_sd_deg[k]),
            size_m=float(signs.size_m[k]),
            side=signs.sides[k] or "",
            n_views=int(signs.n_views[k]),
            first_seen_ns=int(signs.first_seen_ns[k]),
            last_seen_ns=int(signs.last_seen_ns[k]),
        )

    def boxes_of(self, row: int, now: Snapshot) -> list[Box]:
        """The boxes of a sign after the review, in the order of time in each drive."""
        signs, k = self.at(row, now)
        name = signs.ids[k]
        found = []
        for other in self._sources(name, now):
            for number, own_names in self._own_names(other).items():
                drive = self.drives[number]
                rows = self._rows_of(other)
                for own in own_names:
                    for at in drive.rows_of(rows, own).tolist():
                        camera, frame = drive.camera_frame(at)
                        if (
                            now.renamed.name_of(self.table.ids[other], camera, frame, drive.name)
                            == name
                        ):
                            found.append(Box(number, drive, at))
        return found

    def _rows_of(self, row: int) -> IntArray:
        return np.zeros(0, np.int64) if self.merged else self.table.observations_of(row)

    def _sources(self, name: str, now: Snapshot) -> list[int]:
        """Rows of the map's own signs whose boxes a sign may have: itself, those merged into it,
        and those that it was split from."""
        wanted, known = [name], {name}
        for one in wanted:
            more = [gone for gone, into in now.renamed.whole.items() if into == one]
            verdict = now.state.get(one)
            if verdict is not None and verdict.created and verdict.origin in now.rows:
                row = now.rows[verdict.origin]
                table, k = self.at(row, now)
                more.append(table.ids[k])
            fresh = [m for m in more if m not in known]
            wanted += fresh
            known.update(fresh)
        return [self._row_of[one] for one in wanted if one in self._row_of]

    @cached_property
    def _row_of(self) -> dict[str, int]:
        return {name: row for row, name in enumerate(self.table.ids)}

    def _clicks(self, row: int, now: Snapshot) -> list[dict[str, Any]]:
        """Frames in which a reviewer clicked a sign that was added."""
        if row < len(self.table):
            return []
        verdict = now.state.get(now.made[row - len(self.table)])
        number = {drive.name: k for k, drive in enumerate(self.drives)}
        views = []
        for view in () if verdict is None or verdict.origin else verdict.views:
            k = number.get(view.drive)
            at = (view.x_px, view.y_px)
            shown = None if k is None else self.drives[k].clicked(view.camera, view.frame, at)
            if shown is not None:
                views.append({"drive": k, **shown})
        return views

    def _own_names(self, row: int) -> dict[int, list[str]]:
        """What the drives' own runs call a sign of the map, by the number of the drive."""
        name = self.table.ids[row]
        return {0: [name]} if not self.merged else self._sightings.get(name, {})

    @cached_property
    def _sightings(self) -> dict[str, dict[int, list[str]]]:
        """For every sign of a merged map its names by drive."""
        from automap.io.map_tables import SIGHTINGS
        from automap.io.tables import read_table

        number = {drive.name: k for k, drive in enumerate(self.drives)}
        columns = ("drive", "drive_sign", "sign_id")
        try:
            table = read_table(self.out / SIGHTINGS, columns)
        except AutoMapError:
            return {}
        names_of: dict[str, dict[int, list[str]]] = {}
        for drive, own, name in zip(*(table.column(c).to_pylist() for c in columns), strict=True):
            if name and drive in number:
                names_of.setdefault(name, {}).setdefault(number[drive], []).append(own)
        return names_of

    @cached_property
    def _clock(self) -> ClockModel | None:
        """The clock of the signs' stamps."""
        if not self.merged:
            return self.drives[0].clock
        from automap.io.clock_json import read_clock

        try:
            return read_clock(self.out / names.SYNC)
        except (AutoMapError, OSError):
            return None

    def _values(self, signs: SignTable, row: int) -> dict[str, Any]:
        first, last = (
            self._time(stamps[row : row + 1])
            for stamps in (signs.first_seen_ns, signs.last_seen_ns)
        )
        circle = ce95(*(c[row : row + 1] for c in _covariance(signs)))[0]
        values: dict[str, Any] = {
            "id": signs.ids[row],
            "class": signs.class_of(row),
            "confidence": _number(signs.confidence[row], 3),
            "existence": _number(signs.existence[row], 3),
            "n_views": int(signs.n_views[row]),
            "first_seen": first,
            "last_seen": last,
            "height_above_road_m": _number(signs.height_above_road_m[row], 2),
            "sd_above_road_m": _number(signs.sd_above_road_m[row], 2),
            "facing_deg": _number(signs.facing_deg[row], 1),
            "facing_sd_deg": _number(signs.facing_sd_deg[row], 1),
            "size_m": _number(signs.size_m[row], 2),
            "side": signs.sides[row],
            "path_offset_m": _number(signs.path_offset_m[row], 2),
            "contrast": _number(signs.contrast[row], 2),
            "contrast_sd": _number(signs.contrast_sd[row], 2),
            "seen_share": _number(signs.seen_share[row], 2),
            "n_looked": int(signs.n_looked[row]) or None,
            "cov_ee_m2": _number(signs.cov_ee_m2[row], 4),
            "cov_en_m2": _number(signs.cov_en_m2[row], 4),
            "cov_nn_m2": _number(signs.cov_nn_m2[row], 4),
            "sd_u_m": _number(signs.sd_u_m[row], 3),
            "ce95_m": _number(circle, 3),
            "drives": signs.drives_of(row),
            "status": signs.statuses[int(signs.status_index[row])],
        }
        return {name: value for name, value in values.items() if value not in (None, "", [])}

    @cached_property
    def _country(self) -> str | None:
        from pipeline.shared.run_record import country_of
        from pipeline.shared.values import json_object

        return country_of(json_object(self.out / names.RUN))

    def _code_of(self, row: int, now: Snapshot) -> dict[str, str]:
        from automap.signs.national import national_code

        code = national_code(self.class_of(row, now), self._country)
        return {"code": code} if code else {}

    @cached_property
    def _on_roads(self) -> SignRoads:
        return read_sign_roads(self.out, self.problems)

    def _road_of(self, own: str, row: int, now: Snapshot) -> dict[str, Any]:
        """The columns of a sign's road; none of a sign that a review moved since."""
        verdict = next((now.state[n] for n, at in now.rows.items() if at == row), None)
        if verdict is not None and (verdict.lon_deg is not None or verdict.place is not None):
            return {}
        return self._on_roads.values(own, self.class_of(row, now))

    def _time(self, stamps: IntArray) -> str | None:
        return iso_texts(utc_of_stamps(stamps, self._clock))[0]

    def face(self, name: str) -> bytes | None:
        """A picture of a class, PNG; None for what is none."""
        from automap.export.icons import class_icon

        return class_icon(name) if name and self.is_class(name) else None

    def is_class(self, name: str) -> bool:
        """Whether it is a class of the package's, in full or its middle part, or of this map's."""
        from automap.signs.national import is_known_class

        return name in self.table.classes or is_known_class(name)


def _covariance(signs: SignTable) -> tuple[Any, Any, Any]:
    return signs.cov_ee_m2, signs.cov_en_m2, signs.cov_nn_m2


def _number(value: float, decimals: int) -> float | None:
    return round(float(value), decimals) if np.isfinite(value) else None
