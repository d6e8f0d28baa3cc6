"""The review of a viewed map: its state, signs that it made, and actions that are added."""

from __future__ import annotations

import itertools
import threading
import uuid
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from automap.export.uncertainty import principal_axes
from automap.gates import OUTSIDE_95, gate
from automap.io import names
from automap.io.review_json import action_of, append_action, plain_action, read_review, seen_in
from automap.records import PlacedSign, ReviewAction, SeenIn
from automap.review.verdicts import Verdict, standing
from pipeline.shared.run_record import utc_now
from pipeline.view.placing import Part, joined, placed
from pipeline.view.signs import SignTable
from pipeline.view.snapshot import Snapshot, snapshot
from pipeline.view.standing_by import clicked_on_map
from pipeline.view.viewed_map import ViewedMap

_SENT = (
    *("kind", "class_name", "lon_deg", "lat_deg", "sd_m", "note", "undoes", "reviewer", "settles"),
    *("facing_deg", "height_above_road_m"),
)
"""What the page may say of an action; the rest is known here."""


class Reviewing:
    """The review in the folder of a map, which another program may write to as well."""

    def __init__(self, shown: ViewedMap) -> None:
        self._shown = shown
        self._lock = threading.Lock()
        self._kept: tuple[tuple[int, int] | None, Snapshot] | None = None

    @property
    def now(self) -> Snapshot:
        """The review as it stands in the file."""
        path = self._shown.out / names.REVIEW
        with self._lock:
            try:
                stat = path.stat()
                stamp: tuple[int, int] | None = (stat.st_mtime_ns, stat.st_ino)
            except OSError:
                stamp = None
            if self._kept is None or self._kept[0] != stamp:
                actions = [] if stamp is None else read_review(path)
                self._kept = stamp, snapshot(self._shown.table, actions)
            return self._kept[1]

    def told(self, known: int = -1) -> dict[str, Any]:
        """The state of all reviewed signs; only the number of actions when it is ``known``."""
        now = self.now
        told: dict[str, Any] = {"count": len(now.actions)}
        if known == len(now.actions):
            return told
        told["verdicts"] = [_as_told(v, now.rows.get(v.sign)) for v in now.state.values()]
        told["made"] = [] if now.table is None else _rows_told(now.table, len(self._shown.table))
        told["last"] = {
            a.reviewer: {"id": a.id, "sign": a.sign, "kind": a.kind} for a in standing(now.actions)
        }
        told["reviewers"] = sorted({a.reviewer for a in now.actions if a.reviewer})
        return told

    def sign(self, row: int) -> dict[str, Any] | None:
        """All that is known about a sign, with all actions that concerned it."""
        now = self.now
        told = self._shown.sign(row, now)
        return None if told is None else {**told, "history": self._history(row, now)}

    def _history(self, row: int, now: Snapshot) -> list[dict[str, Any]]:
        name = self._name_of(now, row)
        held = {a.id for a in standing(now.actions)}
        return [
            {"id": a.id, "kind": a.kind, "time": a.time, "class": a.class_name, "note": a.note,
             "reviewer": a.reviewer, "stands": a.id in held, "sign": a.sign, "other": a.other}
            for a in now.actions
            if name in (a.sign, a.other)
        ]  # fmt: skip

    def add(self, sent: Any) -> dict[str, Any]:
        """Append what the page sent; ValueError says what is wrong with it."""
        if not isinstance(sent, dict):
            raise ValueError("it is no action on a sign")
        now = self.now
        kind = sent.get("kind")
        value = {name: sent[name] for name in _SENT if sent.get(name) is not None}
        value |= {"id": uuid.uuid4().hex, "time": utc_now()}
        value.setdefault("reviewer", self._shown.reviewer)
        if value.get("class_name") is not None and not self._shown.is_class(value["class_name"]):
            raise ValueError(
                f"{value['class_name']!r} is no known class of signs; choose one of the list"
            )
        if kind == "undo":
            undone = next((a for a in now.actions if a.id == value.get("undoes")), None)
            if undone is None:
                raise ValueError("there is no such action to undo")
            value |= {"sign": undone.sign}
        elif kind == "add":
            value |= self._added(sent)
        else:
            value |= self._about(now, self._checked_row(sent.get("row")))
            if kind == "split":
                value |= self._split(now, sent)
            elif kind == "merge":
                value |= self._merged(now, sent)
        append_action(self._shown.out / names.REVIEW, action_of(value))
        return self.told()

    def preview(self, sent: Any) -> dict[str, Any]:
        """Where a sign stands by the clicks that the page sent; ValueError says why nowhere."""
        views = sent.get("views") if isinstance(sent, dict) else None
        place = self._by_clicks(_views(views), "")
        ee, en, nn, _ = place.cov_m2
        return {"lon_deg": place.lon_deg, "lat_deg": place.lat_deg, "side": place.side,
                "height_above_road_m": place.height_above_road_m,
                **_ellipse(np.array([ee]), np.array([en]), np.array([nn]))}  # fmt: skip

    def _added(self, sent: dict[str, Any]) -> dict[str, Any]:
        """A sign that was missed: clicked on the map, or in frames."""
        name = str(sent.get("class_name") or "")
        if not name:
            raise ValueError("it has no class")
        if sent.get("views"):
            views = _views(sent["views"])
            place = self._by_clicks(views, name)
        else:
            views = ()
            lon, lat = (sent.get(key) for key in ("lon_deg", "lat_deg"))
            if not all(isinstance(v, int | float) and np.isfinite(v) for v in (lon, lat)):
                raise ValueError("it has no place")
            place = clicked_on_map(self._shown, *(float(v) for v in (lon, lat) if v is not None))
        told = plain_action(ReviewAction("", "", "", "add", place=place, views=views))
        value: dict[str, Any] = {key: told[key] for key in ("place", "views") if key in told}
        # the place stands for itself
        return {**value, "lon_deg": None, "lat_deg": None, "sign": f"r{uuid.uuid4().hex[:8]}",
                "seen_class": name, "seen_lon_deg": place.lon_deg,
                "seen_lat_deg": place.lat_deg}  # fmt: skip

    def _by_clicks(self, views: tuple[SeenIn, ...], class_name: str) -> PlacedSign:
        if len({(v.drive, v.camera, v.frame) for v in views}) < 2:
            raise ValueError("it takes a click in two frames at least")
        if any(np.isnan(v.x_px) for v in views):
            raise ValueError("a view does not say where it was clicked")
        parts = []
        for drive in self._shown.drives:
            own = tuple(v for v in views if v.drive == drive.name)
            if own:
                parts.append(Part(drive, clicks=own))
        return placed(parts, class_name, self._shown.merged)

    def _split(self, now: Snapshot, sent: dict[str, Any]) -> dict[str, Any]:
        """Views that are another sign's, and where both stand."""
        row = sent["row"]
        leaving = {(v.drive, v.camera, v.frame) for v in _views(sent.get("views"))}
        boxes = self._shown.boxes_of(row, now)
        key = {b: (b.drive.name, *b.drive.camera_frame(b.row)) for b in boxes}
        out = [b for b in boxes if key[b] in leaving]
        rest = [b for b in boxes if key[b] not in leaving]
        if not out or not rest:
            raise ValueError("a split leaves views to both signs")
        name = str(sent.get("class_name") or self._shown.class_of(row, now))
        places = [self._by_boxes(part, name) for part in (rest, out)]
        views = tuple(SeenIn(*key[b]) for b in out)
        told = plain_action(
            ReviewAction("", "", "", "split", place=places[0], other_place=places[1], views=views)
        )
        # the class is the new sign's
        return {"place": told["place"], "other_place": told["other_place"], "views": told["views"],
                "other": f"r{uuid.uuid4().hex[:8]}", "other_seen_class": name, "class_name": None,
                "other_seen_lon_deg": places[1].lon_deg,
                "other_seen_lat_deg": places[1].lat_deg}  # fmt: skip

    def _merged(self, now: Snapshot, sent: dict[str, Any]) -> dict[str, Any]:
        """Another sign that is this one, and where it stands by the views of both."""
        row, other = sent["row"], self._checked_row(sent.get("other"))
        if row == other:
            raise ValueError("a sign is one with itself already")
        boxes = [*self._shown.boxes_of(row, now), *self._shown.boxes_of(other, now)]
        try:
            place = self._by_boxes(boxes, self._shown.class_of(row, now))
        except ValueError:
            # without the recording the two places are all that is known
            place = joined(self._shown.placed(row, now), self._shown.placed(other, now))
        told = plain_action(ReviewAction("", "", "", "merge", place=place))
        about = self._about(now, other)
        return {"place": told["place"], "other": about["sign"],
                **{f"other_{k}": v for k, v in about.items() if k.startswith("seen_")}}  # fmt: skip

    def _by_boxes(self, boxes: list[Any], class_name: str) -> PlacedSign:
        parts = []
        for drive in self._shown.drives:
            rows = tuple(b.row for b in boxes if b.drive is drive)
            if rows:
                parts.append(Part(drive, rows))
        return placed(parts, class_name, self._shown.merged)

    def _checked_row(self, row: Any) -> int:
        size = len(self._shown.table) + len(self.now.made)
        if isinstance(row, bool) or not isinstance(row, int) or not 0 <= row < size:
            raise ValueError("there is no such sign")
        return row

    def _about(self, now: Snapshot, row: int) -> dict[str, Any]:
        """What an action says of the sign that it is about."""
        table, k = self._shown.at(row, now)
        lon, lat = float(table.lon_deg[k]), float(table.lat_deg[k])
        place = {"seen_lon_deg": round(lon, 9), "seen_lat_deg": round(lat, 9)}
        return {
            "sign": self._name_of(now, row),
            "seen_class": table.class_of(k),
            **{key: v for key, v in place.items() if np.isfinite(v)},
        }

    def _name_of(self, now: Snapshot, row: int) -> str:
        """What the review calls a sign: its id, unless an earlier run's sign has that name or
        this one was reviewed under another."""
        for name, at in now.rows.items():
            if at == row:
                return name
        if row >= len(self._shown.table):
            return now.made[row - len(self._shown.table)]
        name = self._shown.table.ids[row]
        taken = set(now.state)
        candidates = itertools.chain([name], (f"{name}#{k}" for k in itertools.count(2)))
        return next(n for n in candidates if n not in taken)


def _views(value: Any) -> tuple[SeenIn, ...]:
    if not isinstance(value, list):
        raise ValueError("it has no views")
    return tuple(seen_in(view) for view in value)


def _as_told(verdict: Verdict, row: int | None) -> dict[str, Any]:
    """A verdict for the page: a computed place as the place, with its ellipse."""
    told = asdict(replace(verdict, place=None, views=()))
    place = verdict.place
    if place is not None and verdict.lon_deg is None:
        ee, en, nn, _ = place.cov_m2
        told |= {"lon_deg": place.lon_deg, "lat_deg": place.lat_deg, "computed": True}
        told |= _ellipse(np.array([ee]), np.array([en]), np.array([nn]))
    if place is not None and verdict.facing_deg is None:
        told["facing_deg"] = place.facing_deg
    kept = {k: v for k, v in told.items() if k == "status" or _says_something(v)}
    return {"row": row, **kept}


def _says_something(value: Any) -> bool:
    """Whether it is no gap; zero is none, it faces north, or lies on the meridian."""
    return value is not None and value is not False and value not in ("", ()) and value == value


def _rows_told(table: SignTable, first: int) -> list[dict[str, Any]]:
    """Signs that the review made, as further rows of the page's table."""
    told = []
    for k in range(len(table)):
        one = slice(k, k + 1)
        values = {
            "row": first + k,
            "id": table.ids[k],
            "class": table.class_of(k),
            "lon_deg": float(table.lon_deg[k]),
            "lat_deg": float(table.lat_deg[k]),
            "facing": float(table.facing_deg[k]),
            "confidence": float(table.confidence[k]),
            "existence": float(table.existence[k]),
            "drives": table.drives_of(k),
            **_ellipse(table.cov_ee_m2[one], table.cov_en_m2[one], table.cov_nn_m2[one]),
        }
        told.append({name: v for name, v in values.items() if v == v})
    return told


def _ellipse(ee: Any, en: Any, nn: Any) -> dict[str, float]:
    """Semi-axes in m and azimuth in rad of the 95 % ellipse; none for an unknown covariance."""
    major, minor, azimuth = principal_axes(ee, en, nn)
    scale = float(np.sqrt(gate(OUTSIDE_95, 2)))
    values = {"major": scale * major[0], "minor": scale * minor[0], "azimuth": azimuth[0]}
    return {name: float(v) for name, v in values.items() if np.isfinite(v)}
