"""A map as the page shows it: signs, drives, and the review as it stands."""

from __future__ import annotations

import itertools
import threading
import uuid
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from automap.errors import AutoMapError, InputError
from automap.export.clock import iso_texts, utc_of_stamps
from automap.export.fields import SIGN_FIELDS
from automap.export.uncertainty import ce95
from automap.io import names
from automap.io.json_text import parse_json
from automap.io.review_json import action_of, append_action, read_review
from automap.mapping.review import Verdict, match, standing, verdicts
from automap.records import ClockModel, IntArray, ReviewAction
from pipeline.shared.run_record import drive_of, utc_now
from pipeline.view.drives import MapDrive
from pipeline.view.payload import sign_payload
from pipeline.view.signs import SignTable, read_sign_table

_SENT = ("kind", "class_name", "lon_deg", "lat_deg", "sd_m", "note", "undoes")
"""What the page may say of an action; the rest is known here."""


@dataclass
class ViewedMap:
    """The map in ``out``. ``drives`` are in the order of their numbers on the page."""

    out: Path
    name: str
    merged: bool
    signs: SignTable | None
    drives: list[MapDrive]
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)
    _review: tuple[tuple[int, int], list[ReviewAction]] | None = field(default=None, repr=False)

    @cached_property
    def payload(self) -> bytes:
        """All signs for the page's map."""
        return b"" if self.signs is None else sign_payload(self.signs)

    def overview(self) -> dict[str, Any]:
        """What the page needs first.

        ``classes_known`` are the names that a correction is offered, ``faces`` the numbers of
        the classes that have a picture.
        """
        from automap.signs.classes import load_classes
        from automap.signs.vocabulary import load_vocabulary

        vocabulary = set(load_vocabulary().classes)
        own = [] if self.signs is None else self.signs.classes
        return {
            "name": self.name,
            "merged": self.merged,
            "signs": 0 if self.signs is None else len(self.signs),
            "drives": [drive.name for drive in self.drives],
            "fields": [{"name": f.name, "unit": f.unit, "meaning": f.meaning} for f in SIGN_FIELDS],
            "classes_known": sorted(vocabulary.union(own, load_classes())),
            "faces": [number for number, name in enumerate(own) if name in vocabulary],
            "report": (self.out / names.REPORT).is_file(),
        }

    def sign(self, row: int) -> dict[str, Any] | None:
        """All that is known about one sign, None for a row that is not there."""
        signs = self.signs
        if signs is None or not 0 <= row < len(signs):
            return None
        own = self._own_names(row)
        views = []
        for number, sign_ids in own.items():
            rows = np.zeros(0, np.int64) if self.merged else signs.observations_of(row)
            for sign_id in sign_ids:
                found = self.drives[number].views(rows, sign_id)
                views += [{"drive": number, **view} for view in found]
        return {
            "id": signs.ids[row],
            "lon_deg": _number(signs.lon_deg[row], 7),
            "lat_deg": _number(signs.lat_deg[row], 7),
            "height_m": _number(signs.height_m[row], 2),
            "values": self._values(signs, row),
            "views": views,
            "names": own,
            "history": self._history(row),
        }

    def _history(self, row: int) -> list[dict[str, Any]]:
        actions = self._actions()
        name = self._name_in_review(actions, row)
        return [
            {"kind": a.kind, "time": a.time, "class": a.class_name, "note": a.note}
            for a in actions
            if a.sign == name
        ]

    def _own_names(self, row: int) -> dict[int, list[str]]:
        """What the drives' own runs call a sign of the map, by the number of the drive."""
        assert self.signs is not None
        name = self.signs.ids[row]
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
            "n_views": int(signs.n_views[row]),
            "first_seen": first,
            "last_seen": last,
            "height_above_road_m": _number(signs.height_above_road_m[row], 2),
            "sd_above_road_m": _number(signs.sd_above_road_m[row], 2),
            "facing_deg": _number(signs.facing_deg[row], 1),
            "facing_sd_deg": _number(signs.facing_sd_deg[row], 1),
            "size_m": _number(signs.size_m[row], 2),
            "side": signs.sides[row],
            "cov_ee_m2": _number(signs.cov_ee_m2[row], 4),
            "cov_en_m2": _number(signs.cov_en_m2[row], 4),
            "cov_nn_m2": _number(signs.cov_nn_m2[row], 4),
            "sd_u_m": _number(signs.sd_u_m[row], 3),
            "ce95_m": _number(circle, 3),
            "drives": signs.drives_of(row),
            "status": signs.statuses[int(signs.status_index[row])],
        }
        return {name: value for name, value in values.items() if value not in (None, "", [])}

    def _time(self, stamps: IntArray) -> str | None:
        return iso_texts(utc_of_stamps(stamps, self._clock))[0]

    def face(self, class_index: int) -> bytes | None:
        """A picture of a class, PNG; None where the vocabulary has none."""
        if self.signs is None or not 0 <= class_index < len(self.signs.classes):
            return None
        import base64

        from pipeline.report.map_data import sign_faces

        name = self.signs.classes[class_index]
        uri = sign_faces({name}).get(name)
        return None if uri is None else base64.b64decode(uri.partition(",")[2])

    def review(self, known: int = -1) -> dict[str, Any]:
        """The state of all reviewed signs; only the number of actions when it is ``known``."""
        actions = self._actions()
        state: dict[str, Any] = {"count": len(actions)}
        if known == len(actions):
            return state
        told = []
        for verdict, row in self._decided(actions):
            content = asdict(verdict)
            told.append({"row": row, **{k: v for k, v in content.items() if not _is_nan(v)}})
        last = standing(actions)[-1:]
        state["verdicts"] = told
        state["last"] = [{"id": a.id, "sign": a.sign, "kind": a.kind} for a in last]
        return state

    def add(self, sent: Any) -> dict[str, Any]:
        """Append what the page sent; ValueError says what is wrong with it."""
        if not isinstance(sent, dict) or self.signs is None:
            raise ValueError("it is no action on a sign")
        row = sent.get("row")
        if isinstance(row, bool) or not isinstance(row, int) or not 0 <= row < len(self.signs):
            raise ValueError("there is no such sign")
        signs = self.signs
        value = {name: sent[name] for name in _SENT if sent.get(name) is not None}
        actions = self._actions()
        value |= {
            "sign": self._name_in_review(actions, row),
            "id": uuid.uuid4().hex,
            "time": utc_now(),
            "seen_class": signs.class_of(row),
            "seen_lon_deg": _number(signs.lon_deg[row], 9),
            "seen_lat_deg": _number(signs.lat_deg[row], 9),
        }
        action = action_of(value)
        if action.kind == "undo" and action.undoes not in {a.id for a in actions}:
            raise ValueError("there is no such action to undo")
        if action.class_name is not None and not self._is_class(action.class_name):
            raise ValueError(
                f"{action.class_name!r} is no known class of signs; choose one of the list"
            )
        append_action(self.out / names.REVIEW, action)
        return self.review()

    def _is_class(self, name: str) -> bool:
        """Whether it is a class of the package's, in full or its middle part, or of this map's."""
        from automap.signs.classes import load_classes
        from automap.signs.national import class_entry

        own = [] if self.signs is None else self.signs.classes
        middles = {full.split("--")[1] for full in load_classes() if "--" in full}
        return class_entry(name) is not None or name in middles or name in own

    def _decided(self, actions: list[ReviewAction]) -> list[tuple[Verdict, int | None]]:
        """What was decided about signs, each with its row, None for one that is gone."""
        decided = list(verdicts(actions).values())
        signs = self.signs
        if signs is None or not decided:
            return [(verdict, None) for verdict in decided]
        classes = np.array(signs.classes, object)[signs.class_index].tolist()
        rows = match(decided, signs.ids, classes, signs.lon_deg, signs.lat_deg)
        return list(zip(decided, rows, strict=True))

    def _name_in_review(self, actions: list[ReviewAction], row: int) -> str:
        """What the review calls a sign: its id, unless an earlier run's sign has that name or
        this one was reviewed under another."""
        assert self.signs is not None
        decided = self._decided(actions)
        for verdict, at in decided:
            if at == row:
                return verdict.sign
        name = self.signs.ids[row]
        taken = {verdict.sign for verdict, _ in decided}
        candidates = itertools.chain([name], (f"{name}#{k}" for k in itertools.count(2)))
        return next(n for n in candidates if n not in taken)

    def _actions(self) -> list[ReviewAction]:
        """The actions in the file, which another program may have changed."""
        path = self.out / names.REVIEW
        with self._lock:
            try:
                state = path.stat()
            except OSError:
                return []
            stamp = (state.st_mtime_ns, state.st_ino)
            if self._review is None or self._review[0] != stamp:
                self._review = stamp, read_review(path)
            return self._review[1]


def open_map(out: Path) -> ViewedMap:
    """Read the map in an output folder, or in the ``_automap`` of a drive folder.

    Raises InputError when there is neither a sign nor a trajectory, or a damaged review.
    """
    if (out / names.MANIFEST).is_file() and (out / names.DEFAULT_OUT).is_dir():
        out = out / names.DEFAULT_OUT
    if not out.is_dir():
        raise InputError(f"{out} is no output folder of automap run; run the drive first.")
    signs = read_sign_table(out)
    merged = _merged_drives(out)
    drives = [_own_drive(out)] if merged is None else merged
    if signs is None and (merged is not None or drives[0].trajectory is None):
        inside = sorted(p.parent.name for p in out.glob(f"*/{names.RUN}"))
        hint = f"; it has the runs {', '.join(inside[:4])}, view one of them" if inside else ""
        raise InputError(f"{out} holds neither signs nor a trajectory{hint or '; run the drive'}.")
    read_review(out / names.REVIEW)
    name = drives[0].name if merged is None else out.resolve().name
    return ViewedMap(out.resolve(), name, merged is not None, signs, drives)


def _merged_drives(out: Path) -> list[MapDrive] | None:
    """The drives of a merged map, None where ``out`` is the map of one run."""
    if not (out / names.MERGE).is_file():
        return None
    try:
        listed = parse_json((out / names.MERGE).read_text(encoding="utf-8"))["drives"]
        return [_drive_of(out, str(value["name"]), Path(value["folder"])) for value in listed]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{out / names.MERGE} cannot be used ({error}); merge the drives again."
        ) from error


def _drive_of(out: Path, name: str, folder: Path) -> MapDrive:
    """A drive of a merged map; a folder that is no longer there shows nothing of it."""
    root = out.resolve()
    # a relative name was one of where the merge was started, mostly beside the map
    places = [folder, root.parent / folder, root / folder, root.parent / folder.name]
    place = next((p for p in places if (p / names.RUN).is_file()), None)
    if place is None:
        lost = f"The results of {name} are not at {folder} any more, so its views are not shown."
        return MapDrive(name, None, None, [lost])
    found = _own_drive(place)
    return MapDrive(name, place, found.folder)


def _own_drive(out: Path) -> MapDrive:
    """The drive that a run in ``out`` was made of."""
    name, folder = drive_of(out)
    if not (folder / names.MANIFEST).is_file():
        folder = out.resolve().parent
    known = (folder / names.MANIFEST).is_file()
    return MapDrive(name, out, folder if known else None)


def _covariance(signs: SignTable) -> tuple[Any, Any, Any]:
    return signs.cov_ee_m2, signs.cov_en_m2, signs.cov_nn_m2


def _number(value: float, decimals: int) -> float | None:
    return round(float(value), decimals) if np.isfinite(value) else None


def _is_nan(value: Any) -> bool:
    return value is None or (isinstance(value, float) and not np.isfinite(value))
