"""What a merged map takes over from its drives beside where signs stand: pictures of the best
views, tracks, observations, heights of the geoid, and what reviewers wrote."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from automap.io import names
from automap.io.map_tables import TRACKS, write_tracks
from automap.records import (
    TRACK_PROBABILITIES,
    ClockModel,
    FloatArray,
    IntArray,
    Sign,
    Trajectory,
)
from automap.records.sign_lists import changed, values_of
from pipeline.shared.pictures import Picture, read_pictures, write_pictures
from pipeline.shared.products import RunProducts, geoid_separation, load_products

if TYPE_CHECKING:
    import pyarrow as pa


TRACK_STEP_M, TRACK_STEP_S = 4.0, 1.0
"""A track has a row every so many metres, and at least every so many seconds, which is often enough
to place an observation on it."""
PICTURES_EACH, MANY_SIGNS, MOST_PICTURED = 3, 2000, 20_000
"""Pictures of a sign, as in a run; of more signs than that the best alone, and of still more none:
they are held in memory until all drives are read, some 8 kB each."""
MOST_OBSERVATIONS = 2_000_000
"""Rows of observations: as many are some 400 MB while they are written, and a layer that a GIS
still opens."""
MANY_DRIVES = 200
"""From so many drives on tracks are coarser, so that all together stay as large."""


@dataclass
class Whole:
    """Gathered from the drives: ``tracks`` by the drive's name, tables of observations,
    ``pictures`` of each sign from the best on, its geoid heights, its notes and its reviews (time,
    reviewer, status and class); ``too_many`` whether there were more observations than are kept."""

    tracks: dict[str, Trajectory] = field(default_factory=dict)
    observations: list[pa.Table] = field(default_factory=list)
    pictures: dict[str, list[Picture]] = field(default_factory=dict)
    geoid_m: dict[str, list[float]] = field(default_factory=dict)
    notes: dict[str, list[str]] = field(default_factory=dict)
    reviews: dict[str, list[tuple[str, str, str, str]]] = field(default_factory=dict)
    too_many: bool = False


@dataclass(frozen=True)
class Contribution:
    """A drive of a merge: its name in the map, the folder of its run, and which of its own signs,
    by their ids there, are which of the map's."""

    drive: str
    folder: Path
    named: Mapping[str, str]


def gather(drives: Iterable[Contribution], number_of_signs: int, warnings: list[str]) -> Whole:
    """What the drives of a merge have of the map's signs; what a drive cannot give is added to
    ``warnings``."""
    whole = Whole()
    drives = list(drives)
    each = PICTURES_EACH if number_of_signs <= MANY_SIGNS else 1
    if number_of_signs > MOST_PICTURED:
        each = 0
        warnings.append(
            f"The map has more than {MOST_PICTURED} signs: their pictures stay in the drives' "
            "folders."
        )
    step_m = TRACK_STEP_M * max(1.0, len(drives) / MANY_DRIVES)
    for each_drive in drives:
        name, folder, named = each_drive.drive, each_drive.folder, each_drive.named
        products = load_products(folder)
        _take_notes(whole, products, name, named)
        if products.clock is None:
            if products.trajectory is not None:
                warnings.append(
                    f"{folder}: its clock is not tied to GPS time, so its track and observations "
                    "are not in the map."
                )
            continue
        _take_drive(whole, products, products.clock, name, named, step_m)
        if each:
            _take_pictures(whole, products, products.clock, name, named, each)
        if sum(map(len, whole.observations)) > MOST_OBSERVATIONS:
            whole.observations, whole.too_many = [], True
    if whole.too_many:
        warnings.append(
            f"The map's signs have more than {MOST_OBSERVATIONS} observations: they stay in the "
            "drives' folders."
        )
    return whole


def complete(signs: Sequence[Sign], whole: Whole) -> Sequence[Sign]:
    """The signs with heights of the geoid, notes, and what was decided about them last in a drive:
    a class that a person gave or accepted outranks what detectors called it in other drives."""
    ids, noted = values_of(signs, "id"), values_of(signs, "note")
    notes = [[*([note] if note else []), *whole.notes.get(name, [])] for name, note in
             zip(ids, noted, strict=True)]  # fmt: skip
    values: dict[str, list[Any]] = {
        name: list(values_of(signs, name))
        for name in ("class_name", "status", "reviewed", "reviewer", "confidence", "existence")
    }
    doubts = {name: list(values_of(signs, name)) for name in TRACK_PROBABILITIES}
    for k, name in enumerate(ids):
        if name not in whole.reviews:
            continue
        when, who, status, class_name = max(whole.reviews[name])
        values["reviewed"][k], values["reviewer"][k], values["status"][k] = when, who, status
        values["class_name"][k], values["confidence"][k] = class_name, values["existence"][k]
        # what detectors believe is no measure of what a person says
        for of_class in doubts.values():
            of_class[k] = math.nan
    return changed(
        signs,
        geoid_m=[float(np.mean(t)) if (t := whole.geoid_m.get(name)) else np.nan for name in ids],
        note=["; ".join(each) for each in notes],
        **values,
        **doubts,
    )


def write_whole(out: Path, whole: Whole) -> None:
    """Write tracks, observations and pictures as far as there are any."""
    write_tracks(out / TRACKS, whole.tracks.items())
    if whole.observations:
        import pyarrow as pa
        import pyarrow.parquet as pq

        table = pa.concat_tables(whole.observations, promote_options="permissive")
        pq.write_table(table, out / names.OBSERVATIONS, compression="zstd")
    pictures = [
        replace(
            picture,
            view=replace(picture.view, rank=rank),
            # the nearest view alone shows its street
            context=picture.context if rank == 1 else None,
        )
        for _, own in sorted(whole.pictures.items())
        for rank, picture in enumerate(own, start=1)
    ]
    if pictures:
        write_pictures(out, pictures)


def _take_notes(whole: Whole, products: RunProducts, drive: str, named: Mapping[str, str]) -> None:
    for sign in products.signs or []:
        if sign.reviewed and sign.id in named:
            review = (sign.reviewed, sign.reviewer, sign.status, sign.class_name)
            whole.reviews.setdefault(named[sign.id], []).append(review)
        if sign.note and sign.id in named:
            whole.notes.setdefault(named[sign.id], []).append(f"{drive}: {sign.note}")


def _gps_ns(clock: ClockModel, t_ns: IntArray) -> IntArray:
    """Stamps [n] as a merged map's clock has them: GPS time in ns."""
    return np.rint(clock.gps_s(np.asarray(t_ns, np.int64)) * 1e9).astype(np.int64)


def _take_drive(
    whole: Whole,
    products: RunProducts,
    clock: ClockModel,
    drive: str,
    named: Mapping[str, str],
    step_m: float,
) -> None:
    if products.trajectory is not None:
        track = thinned(products.trajectory, step_m)
        whole.tracks[drive] = replace(track, t_ns=_gps_ns(clock, track.t_ns))
    seen = [sign for sign in products.signs or [] if sign.id in named]
    stamps = np.array([(s.first_seen_ns + s.last_seen_ns) // 2 for s in seen], np.int64)
    geoid = geoid_separation(products, stamps)
    for sign, height in zip(seen, () if geoid is None else geoid.tolist(), strict=False):
        whole.geoid_m.setdefault(named[sign.id], []).append(height)
    table = products.observations
    if table is not None and not whole.too_many and {"sign_id", "t_ns"} <= set(table.column_names):
        whole.observations.append(_observations(table, clock, drive, named))


def drive_essentials(folder: Path) -> tuple[Trajectory | None, dict[str, float]]:
    """A run's trajectory in GPS time, None without one that is tied to it, and the height of the
    geoid at its signs, by their ids."""
    products = load_products(folder)
    clock = products.clock
    if clock is None:
        return None, {}
    track = products.trajectory
    if track is not None:
        track = thinned(track)
        track = replace(track, t_ns=_gps_ns(clock, track.t_ns))
    signs = products.signs or []
    stamps = np.array([(s.first_seen_ns + s.last_seen_ns) // 2 for s in signs], np.int64)
    geoid = geoid_separation(products, stamps)
    told = () if geoid is None else geoid.tolist()
    return track, dict(zip([sign.id for sign in signs], told, strict=False))


def _observations(
    table: pa.Table, clock: ClockModel, drive: str, named: Mapping[str, str]
) -> pa.Table:
    """The detections of the map's signs, under their names there and in its time."""
    import pyarrow as pa

    ids = [named.get(own or "", "") for own in table["sign_id"].to_pylist()]
    kept = np.flatnonzero(np.array([bool(i) for i in ids], np.bool_))
    table = table.take(pa.array(kept))
    t_ns = _gps_ns(clock, np.asarray(table["t_ns"].to_numpy(), np.int64))
    columns = {name: table[name] for name in table.column_names}
    columns |= {"sign_id": pa.array([ids[k] for k in kept], pa.string()), "t_ns": pa.array(t_ns)}
    return pa.table({"drive": pa.array([drive] * len(kept), pa.string()), **columns})


def _take_pictures(
    whole: Whole,
    products: RunProducts,
    clock: ClockModel,
    drive: str,
    named: Mapping[str, str],
    each: int,
) -> None:
    """Pictures of the largest boxes, which show most of a sign."""
    for picture in read_pictures(products):
        if (name := named.get(picture.view.sign_id)) is None:
            continue
        view = replace(
            picture.view,
            sign_id=name,
            camera=f"{drive} {picture.view.camera}",
            t_ns=int(_gps_ns(clock, np.array([picture.view.t_ns]))[0]),
        )
        own = whole.pictures.setdefault(name, [])
        own.append(replace(picture, view=view))
        own.sort(key=lambda p: -_height(p.view.box))
        del own[each:]


def _height(box: FloatArray) -> float:
    return float(box[3] - box[1])


def thinned(trajectory: Trajectory, step_m: float = TRACK_STEP_M) -> Trajectory:
    """Rows of a trajectory that are ``step_m`` or ``TRACK_STEP_S`` apart, and the last."""
    if len(trajectory) < 2:
        return trajectory
    speed = np.linalg.norm(np.nan_to_num(trajectory.vel_ned), axis=1)
    seconds = (trajectory.t_ns - trajectory.t_ns[0]) * 1e-9
    gone = np.concatenate([[0.0], np.cumsum(speed[1:] * np.diff(seconds))])
    step = np.diff(np.floor(gone / step_m), prepend=-1.0) > 0
    step |= np.diff(np.floor(seconds / TRACK_STEP_S), prepend=-1.0) > 0
    step[-1] = True
    rows = np.flatnonzero(step)
    return Trajectory(**{name: values[rows] for name, values in vars(trajectory).items()})
