"""Signs as they are after a review, and which of its verdicts is about which sign."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from automap.mapping.changes import one_to_one
from automap.mapping.grid import east_north
from automap.records import TRACK_PROBABILITIES, FloatArray, PlacedSign, ReviewAction, Sign
from automap.records.signs import BY_SIZE
from automap.review import limits
from automap.review.verdicts import Verdict, verdicts
from automap.signs.national import is_known_class


@dataclass(frozen=True)
class Renamed:
    """Views that a review gives to other signs: ``single`` by sign, camera and frame (and drive),
    ``whole`` all of a sign's that was merged."""

    single: dict[tuple[str, str, int], list[tuple[str, str]]] = field(default_factory=dict)
    whole: dict[str, str] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.single or self.whole)

    def name_of(self, sign: str, camera: str, frame: int, drive: str = "") -> str:
        """What the sign of a view is called after the review; ``drive`` "" is any."""
        for of_drive, name in self.single.get((sign, camera, frame), ()):
            if not drive or not of_drive or drive == of_drive:
                sign = name
        seen = {sign}
        while (into := self.whole.get(sign)) is not None and into not in seen:
            seen.add(into)
            sign = into
        return sign


@dataclass(frozen=True)
class Reviewed:
    """Signs after a review: those for the map, those rejected, sentences about the rest, and what
    became of views."""

    signs: list[Sign]
    rejected: list[Sign]
    problems: list[str] = field(default_factory=list)
    renamed: Renamed = field(default_factory=Renamed)


def apply_review(signs: Sequence[Sign], actions: Iterable[ReviewAction]) -> Reviewed:
    """Signs with the review applied, in their order, those that it made at the end.

    A sign that was decided about says so in ``status``, with who decided and when; a rejected one
    is left out and listed apart, one that was merged into another is gone; notes go with their
    signs. A position set by hand has the reviewer's uncertainty in place of the computed one. A
    verdict whose sign is not there any more becomes a sentence and changes nothing.
    """
    state = verdicts(actions)
    decided = [verdict for verdict in state.values() if not verdict.created]
    rows = match(
        decided,
        [sign.id for sign in signs],
        [sign.class_name for sign in signs],
        np.degrees([sign.lon_rad for sign in signs]),
        np.degrees([sign.lat_rad for sign in signs]),
    )
    row_of = {v.sign: row for v, row in zip(decided, rows, strict=True) if row is not None}
    lost = [v.sign for v in decided if v.status and v.sign not in row_of]
    after = list(signs)
    for name, row in row_of.items():
        after[row] = _changed(signs[row], state[name])
    for verdict in state.values():
        origin = signs[row_of[verdict.origin]] if verdict.origin in row_of else None
        if verdict.created and (sign := created_sign(verdict, origin)) is not None:
            after.append(sign)
    called = {v.sign: v.sign for v in state.values() if v.created}
    called |= {name: signs[row].id for name, row in row_of.items()}
    after = _joined(after, state, called)
    return Reviewed(
        signs=[sign for sign in after if sign.status not in ("rejected", "merged")],
        rejected=[sign for sign in after if sign.status == "rejected"],
        problems=_problems(lost, state, {sign.class_name for sign in signs}),
        renamed=renamed_views(state, called),
    )


def _problems(lost: list[str], state: dict[str, Verdict], of_map: set[str]) -> list[str]:
    problems = []
    given = {v.class_name: v.sign for v in state.values() if v.class_name and v.status != "merged"}
    strange = sorted(name for name in given if name not in of_map and not is_known_class(name))
    if strange:
        problems.append(
            f"The review names {len(strange)} class{'es' if len(strange) > 1 else ''} that neither "
            f"the map nor the package has, as {strange[0]!r} of {given[strange[0]]}; it stays as "
            "it was written."
        )
    if lost:
        named = ", ".join(lost[:5]) + (" and more" if len(lost) > 5 else "")
        problems.append(
            f"The review decided about {len(lost)} sign{'s' if len(lost) > 1 else ''} that the "
            f"map no longer has ({named}); the decisions stay in the review and change nothing."
        )
    disputed = [v for v in state.values() if v.disputed]
    if disputed:
        first = disputed[0]
        others = ", ".join(first.disputed)
        problems.append(
            f"Reviewers disagree about {len(disputed)} sign{'s' if len(disputed) > 1 else ''}, as "
            f"about {first.sign} ({first.reviewer} against {others}); the last word stands. "
            "automap view lists them as disputed."
        )
    return problems


def created_sign(verdict: Verdict, origin: Sign | None = None) -> Sign | None:
    """A sign that the review made, as it decided about it since; None where it has no place. Out
    of ``origin`` it keeps what its boxes were worth."""
    place = verdict.place
    if place is None:
        return None
    nan = float("nan")
    drives = tuple(sorted({view.drive for view in verdict.views if view.drive}))
    sign = Sign(
        id=verdict.sign,
        class_name=verdict.seen_class,
        lat_rad=nan,
        lon_rad=nan,
        height_m=nan,
        cov_enu=np.full((3, 3), nan),
        confidence=nan if origin is None else origin.confidence,
        n_views=place.n_views,
        first_seen_ns=place.first_seen_ns,
        last_seen_ns=place.last_seen_ns,
        height_above_road_m=nan,
        facing_rad=nan,
        size_m=nan,
        side=place.side,
        drives=drives or (() if origin is None else origin.drives),
        existence=nan if origin is None else origin.existence,
    )
    return _changed(sign, verdict)


def _joined(signs: list[Sign], state: dict[str, Verdict], called: dict[str, str]) -> list[Sign]:
    """Signs with the drives of those that were merged into them."""
    more: dict[str, set[str]] = {}
    own = {sign.id: sign for sign in signs}
    for verdict in state.values():
        gone, into = own.get(called.get(verdict.sign, "")), called.get(verdict.into, "")
        if verdict.status == "merged" and gone is not None:
            more.setdefault(into, set()).update(gone.drives)
    return [
        replace(s, drives=tuple(sorted({*s.drives, *more[s.id]}))) if s.id in more else s
        for s in signs
    ]


def renamed_views(state: dict[str, Verdict], called: dict[str, str]) -> Renamed:
    """What becomes of views by the verdicts; ``called`` are the map's names of their signs."""
    single: dict[tuple[str, str, int], list[tuple[str, str]]] = {}
    whole = {}
    for verdict in state.values():
        if verdict.created and verdict.origin in called:
            for view in verdict.views:
                key = (called[verdict.origin], view.camera, view.frame)
                single.setdefault(key, []).append((view.drive, verdict.sign))
        if verdict.status == "merged" and {verdict.sign, verdict.into} <= set(called):
            whole[called[verdict.sign]] = called[verdict.into]
    return Renamed(single, whole)


def _changed(sign: Sign, verdict: Verdict) -> Sign:
    if verdict.place is not None:
        sign = _placed(sign, verdict.place)
    changes: dict[str, object] = {}
    if verdict.status:
        changes |= {
            "status": verdict.status,
            "reviewer": verdict.reviewer,
            "reviewed": verdict.time,
        }
    if verdict.note:
        # whoever decides about the sign may be another one
        changes["note"] = f"{verdict.note} ({verdict.note_by})"
    if verdict.class_name is not None:
        changes["class_name"] = verdict.class_name
        if verdict.class_name != sign.class_name:
            # what the detector believed is another class
            changes |= dict.fromkeys(TRACK_PROBABILITIES, float("nan"))
    if verdict.lon_deg is not None and verdict.lat_deg is not None:
        variance = (limits.HAND_SD_M if verdict.sd_m is None else verdict.sd_m) ** 2
        covariance = np.zeros((3, 3))
        covariance[0, 0] = covariance[1, 1] = variance
        covariance[2, 2] = sign.cov_enu[2, 2]
        changes |= {
            "lon_rad": float(np.radians(verdict.lon_deg)),
            "lat_rad": float(np.radians(verdict.lat_deg)),
            "cov_enu": covariance,
            **dict.fromkeys(("path_offset_m", *BY_SIZE), float("nan")),
        }
    if verdict.facing_deg is not None:
        changes |= {
            "facing_rad": float(np.radians(verdict.facing_deg % 360.0)),
            "facing_sd_rad": float(np.radians(limits.HAND_FACING_SD_DEG)),
        }
    if verdict.height_above_road_m is not None:
        changes |= {
            "height_above_road_m": verdict.height_above_road_m,
            "sd_above_road_m": limits.HAND_HEIGHT_SD_M,
        }
        raised = verdict.height_above_road_m - sign.height_above_road_m
        if np.isfinite(raised):
            # the road is where it was
            changes["height_m"] = sign.height_m + raised
    return replace(sign, **changes) if changes else sign  # type: ignore[arg-type]


def _placed(sign: Sign, place: PlacedSign) -> Sign:
    """The sign as it was computed when it was added, split or merged."""
    ee, en, nn, uu = place.cov_m2
    changes: dict[str, object] = {
        "lon_rad": float(np.radians(place.lon_deg)),
        "lat_rad": float(np.radians(place.lat_deg)),
        "cov_enu": np.array([[ee, en, 0.0], [en, nn, 0.0], [0.0, 0.0, uu]]),
        "side": place.side or sign.side,
        "path_offset_m": float("nan"),
        # measured of other views
        **dict.fromkeys(("contrast", "contrast_sd", "seen_share", *BY_SIZE), float("nan")),
        **{"contrast_note": "", "n_looked": 0},
    }
    if place.n_views:
        changes |= {"n_views": place.n_views, "first_seen_ns": place.first_seen_ns}
        changes["last_seen_ns"] = place.last_seen_ns
    for name in ("height_m", "height_above_road_m", "sd_above_road_m", "size_m"):
        if np.isfinite(value := getattr(place, name)):
            changes[name] = value
    if np.isfinite(place.facing_deg):
        changes |= {
            "facing_rad": float(np.radians(place.facing_deg)),
            "facing_sd_rad": float(np.radians(place.facing_sd_deg)),
        }
    return replace(sign, **changes)  # type: ignore[arg-type]


def match(
    decided: Sequence[Verdict],
    ids: Sequence[str],
    classes: Sequence[str],
    lon_deg: FloatArray,
    lat_deg: FloatArray,
) -> list[int | None]:
    """For every verdict the row of its sign among signs [n], None where it is gone; no row twice.

    First by the same id near the same place, then by the same class near the same place, the
    nearest pair first. Signs or verdicts without a position are known by id and class.
    """
    row_of = {name: row for row, name in enumerate(ids)} if decided else {}
    pairs: list[tuple[float, int, int]] = []
    for number, verdict in enumerate(decided):
        row = row_of.get(verdict.sign)
        if row is not None:
            far = _distance_m(verdict, lon_deg[row : row + 1], lat_deg[row : row + 1])[0]
            if far <= limits.MATCH_M or (np.isnan(far) and classes[row] == verdict.seen_class):
                # before any that is only near
                pairs.append((-1.0, number, row))
                continue
        far = _distance_m(verdict, lon_deg, lat_deg)
        near = np.flatnonzero(far <= limits.MATCH_M).tolist()
        pairs += [(float(far[k]), number, k) for k in near if classes[k] == verdict.seen_class]
    found = one_to_one(pairs)
    return [found.get(number) for number in range(len(decided))]


def _distance_m(verdict: Verdict, lon_deg: FloatArray, lat_deg: FloatArray) -> FloatArray:
    """Metres [n] to where the verdict's sign was seen; good near by, which is all it is for."""
    seen = np.radians([verdict.seen_lat_deg, verdict.seen_lon_deg])
    return np.asarray(np.hypot(*east_north(np.radians(lat_deg), np.radians(lon_deg), *seen).T))
