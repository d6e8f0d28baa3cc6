"""Inventories with known faults against maps that geolocation made of simulated drives.

The street is that of ``geolocation_world.py``: boxes with errors, missed by frame, on a trajectory
that wanders, located by the estimator itself. Hidden are signs behind what stands between them and
the camera in plan: low crowns that stand there in every drive, vans parked anew for each, and a
lorry that drives ahead for part of the time. Some faces every drive misreads alike, some one
alone.

    python tests/benchmarks/inventory_world.py [--seeds N] [--first N] [--drives 1 3] [--thinner N]

Printed are, per kind, how many are due, told and sure with precision and recall of either; of what
is called missing also the precision where signs count that stand and that no drive can have seen,
since something hid them in every frame; and how often statements of a probability were right.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "unit"))
from inventory_case import KINDS, Faulty, calibrated, correct, due

from automap.earth import from_local_ned, local_ned
from automap.frames import rpy_to_matrix
from automap.geolocation.locate import locate_signs
from automap.inventory.comparison import compare_inventory
from automap.inventory.findings import Inventory
from automap.mapping.limits import LEAST_EXISTENCE
from automap.mapping.merge import merge_drives
from automap.mapping.sightings import CameraView, DriveSigns
from automap.records import BoolArray, DrivePath, FloatArray, IntArray, Looked, Sign
from tests.benchmarks.geolocation_facing import ROUND
from tests.benchmarks.geolocation_world import ORIGIN, Difficulty, World, make_world

ROAD = Difficulty(twice=False, duration_s=420.0, faces=ROUND, turned_deg=6.0, clutter=0.03)
GONE, DELETED, MOVED, OTHER = 0.04, 0.05, 0.05, 0.03
MISREAD_ALIKE, MISREAD = 0.01, 0.015
"""Of signs, those that every drive reads as the same other class, and that one drive does."""
EVERY_M, RADIUS_M = {"crown": 80.0, "van": 60.0}, {"crown": 0.8, "van": 1.0}
"""One crown and one van stand on that length of the road's either side; their radius in plan."""
ASIDE_M = {"crown": (3.0, 6.5), "van": (2.6, 3.6)}
LORRY_SHARE, LORRY_M, LORRY_RADIUS_M = 0.15, 22.0, 1.25


@dataclass(frozen=True)
class Case:
    """A map, the true sign of each of its signs (-1 none), its drives, and the list; ``hidden`` [n]
    true signs that something hid in every frame of every drive; ``left_out`` what drives saw and
    the merged map left out."""

    signs: list[Sign]
    truth: IntArray
    drives: list[DriveSigns]
    faulty: Faulty
    hidden: BoolArray
    left_out: Sequence[Sign] = ()


def case(seed: int, drives: int) -> Case:
    """All from ``seed``; of one drive its own map, of more the merged one."""
    rng = np.random.default_rng([seed, 7])
    worlds = [make_world(seed, ROAD, errors_seed=k) for k in range(drives)]
    n = len(worlds[0].position)
    standing = rng.random(n) >= GONE
    alike = rng.random(n) < MISREAD_ALIKE
    other = rng.choice(len(ROUND), n)
    crowns = _beside(rng, worlds[0], "crown")
    seen = [_seen(rng, seed, k, w, standing, crowns, alike, other) for k, w in enumerate(worlds)]
    parts = [part for part, _, _, _ in seen]
    due_to, left = (sum(np.array([one[3][k] for one in seen])) for k in range(2))
    hidden = standing & (due_to > 0) & (left == 0)
    inventory = _list(rng, worlds[0], standing)
    if drives == 1:
        return Case(seen[0][2], seen[0][1], parts, inventory, hidden)
    merged = merge_drives(parts)
    known = {part.name: truth for part, truth, _, _ in seen}
    own = np.array(
        [
            int(known[merged.drives[d].name][row])
            for d, row in zip(merged.sightings.drive, merged.sightings.row, strict=True)
        ]
    )
    kept = np.flatnonzero(merged.existence >= LEAST_EXISTENCE).tolist()
    truth = np.array([_most(own[merged.sign == k]) for k in kept], np.int64)
    signs = [merged.signs[k] for k in kept]
    left_out = [s for k, s in enumerate(merged.signs) if k not in set(kept)]
    return Case(signs, truth, merged.drives, inventory, hidden, left_out)


def _most(values: IntArray) -> int:
    found, count = np.unique(values, return_counts=True)
    return int(found[np.argmax(count)])


def _beside(rng: np.random.Generator, world: World, kind: str) -> FloatArray:
    """Middles [k, 2] of what stands beside the road, north and east."""
    place = local_ned(world.true.lat_rad, world.true.lon_rad, world.true.height_m, ORIGIN)[:, :2]
    gone = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(place, axis=0), axis=1))])
    number = rng.poisson(2.0 * gone[-1] / EVERY_M[kind])
    row = np.searchsorted(gone, rng.uniform(0.0, gone[-1], number)).clip(0, len(place) - 1)
    yaw = world.true.rpy[row, 2]
    side = np.where(rng.random(number) < 0.5, -1.0, 1.0) * rng.uniform(*ASIDE_M[kind], number)
    middle = place[row] + side[:, None] * np.column_stack([-np.sin(yaw), np.cos(yaw)])
    if kind == "van":
        # five metres long: three discs in a row
        along = np.column_stack([np.cos(yaw), np.sin(yaw)])
        middle = np.vstack([middle + step * along for step in (-1.5, 0.0, 1.5)])
    return middle


def _hidden(camera: FloatArray, sign: FloatArray, discs: FloatArray, radius: float) -> BoolArray:
    """Whether a disc [k, 2] lies across the way from ``camera`` [n, 2] to ``sign`` [n, 2]."""
    hidden = np.zeros(len(camera), np.bool_)
    way = sign - camera
    length = np.linalg.norm(way, axis=1)
    for disc in discs:
        from_camera = disc - camera
        along = np.einsum("ni,ni->n", from_camera, way) / length
        across = np.abs(from_camera[:, 0] * way[:, 1] - from_camera[:, 1] * way[:, 0]) / length
        hidden |= (across < radius) & (along > 1.0) & (along < length - 0.3)
    return hidden


def _seen(
    rng: np.random.Generator, seed: int, number: int, world: World, standing: BoolArray,
    crowns: FloatArray, alike: BoolArray, other: IntArray,
) -> tuple[DriveSigns, IntArray, list[Sign], IntArray]:  # fmt: skip
    """What one drive makes of the street: its signs, the true one of each, the map, and of each
    true sign how many boxes there would be and are [2, n]."""
    found, owner = world.detections, world.owner
    t = found.t_ns + round(world.true_camera.time_offset_s * 1e9)
    row = np.searchsorted(world.true.t_ns, t).clip(0, len(world.true) - 1)
    place = local_ned(world.true.lat_rad, world.true.lon_rad, world.true.height_m, ORIGIN)
    arm = rpy_to_matrix(world.true.rpy[row]) @ world.true_camera.lever_arm_m
    camera = (place[row] + arm)[:, :2]
    sign = world.position[np.maximum(owner, 0), :2]
    hidden = _hidden(camera, sign, crowns, RADIUS_M["crown"])
    hidden |= _hidden(camera, sign, _beside(rng, world, "van"), RADIUS_M["van"])
    # a lorry for a minute at a time
    minute = (world.true.t_ns[row] - world.true.t_ns[0]) // 60_000_000_000
    behind = (rng.random(int(minute.max()) + 1) < LORRY_SHARE)[minute]
    yaw = world.true.rpy[row, 2]
    lorry = camera + LORRY_M * np.column_stack([np.cos(yaw), np.sin(yaw)])
    for k in np.flatnonzero(behind & (owner >= 0)).tolist():
        hidden[k] |= _hidden(camera[[k]], sign[[k]], lorry[[k]], LORRY_RADIUS_M)[0]
    gone = (owner >= 0) & ~standing[np.maximum(owner, 0)]
    keep = np.flatnonzero(~gone & ~((owner >= 0) & hidden))
    boxes = np.array(
        [np.bincount(own[own >= 0], minlength=len(standing)) for own in (owner, owner[keep])]
    )
    names = found.class_name.copy()
    wrong = alike | (rng.random(len(alike)) < MISREAD)
    alone = np.where(alike, other, rng.choice(len(ROUND), len(alike)))
    for k in np.flatnonzero((owner >= 0) & wrong[np.maximum(owner, 0)]).tolist():
        names[k] = ROUND[alone[owner[k]]]
    frames = np.arange(int(found.frame.max()) + 1)
    whole = [0.0, 0.0, float(world.camera.width), float(world.camera.height)]
    looked = Looked(frames, np.tile(whole, (len(frames), 1)))
    found = replace(
        found, frame=found.frame[keep], t_ns=found.t_ns[keep], class_name=names[keep],
        box=found.box[keep], score=found.score[keep], track=found.track[keep], looked=looked,
    )  # fmt: skip
    owner = owner[keep]
    signs = locate_signs(world.trajectory, [found], {"front": world.camera}).signs
    truth = np.array([_most(owner[s.detection_rows]) for s in signs], np.int64)
    right = np.array(
        [k < 0 or s.class_name == world.class_name[k] for k, s in zip(truth, signs, strict=True)]
    )
    told = calibrated(rng, right, 1.0 - MISREAD - MISREAD_ALIKE)
    signs = [
        replace(s, class_probability=float(p), confidence=s.existence * float(p))
        for s, p in zip(signs, told, strict=True)
    ]
    return _columns(f"drive-{number}", number, world, signs), truth, signs, boxes


def _columns(name: str, number: int, world: World, signs: list[Sign]) -> DriveSigns:
    trajectory = world.trajectory
    gps = 1.4e9 + 86400.0 * number + (trajectory.t_ns - trajectory.t_ns[0]) * 1e-9

    def real(field: str) -> FloatArray:
        return np.array([getattr(s, field) for s in signs], np.float64)

    def seen(field: str) -> FloatArray:
        at = np.array([getattr(s, field) for s in signs], np.int64)
        return np.asarray(
            np.interp(at - trajectory.t_ns[0], trajectory.t_ns - trajectory.t_ns[0], gps)
        )

    way = np.cumsum(np.hypot(*trajectory.vel_ned[:, :2].T)) * 0.02
    rows = np.concatenate([[0], np.flatnonzero(np.diff(np.floor(way / 4.0)) > 0)])
    sd = trajectory.sd_pos_ned[rows][:, [1, 0, 2]]
    path = DrivePath(
        gps[rows], trajectory.lat_rad[rows], trajectory.lon_rad[rows], trajectory.rpy[rows, 2], sd
    )
    return DriveSigns(
        name=name,
        start_gps_s=float(gps[0]),
        ids=tuple(s.id for s in signs),
        class_name=np.array([s.class_name for s in signs], np.object_),
        lat_rad=real("lat_rad"),
        lon_rad=real("lon_rad"),
        height_m=real("height_m"),
        cov_enu=np.array([s.cov_enu for s in signs]),
        confidence=real("confidence"),
        n_views=np.array([s.n_views for s in signs], np.int64),
        first_gps_s=seen("first_seen_ns"),
        last_gps_s=seen("last_seen_ns"),
        height_above_road_m=real("height_above_road_m"),
        sd_above_road_m=real("sd_above_road_m"),
        facing_rad=real("facing_rad"),
        facing_sd_rad=real("facing_sd_rad"),
        size_m=real("size_m"),
        side=np.array([s.side for s in signs], np.object_),
        status=np.array([s.status for s in signs], np.object_),
        path=path,
        cameras=(CameraView(0.0, float(np.arctan(0.64))),),
        class_probability=real("class_probability"),
        group_probability=real("class_probability"),
        existence=real("existence"),
        seen_share=real("seen_share"),
        n_looked=real("n_looked"),
    )


def _list(rng: np.random.Generator, world: World, standing: BoolArray, sd: float = 0.3) -> Faulty:
    """The list: of the signs that stand some are not in it, moved or of another class; those that
    were taken down are."""
    n = len(world.position)
    order = rng.permutation(np.flatnonzero(standing))
    edges = np.cumsum(np.rint(np.array([DELETED, MOVED, OTHER]) * n)).astype(np.int64)
    deleted, moved, other, _ = np.split(order, edges)
    place, names = world.position.copy(), np.array(world.class_name, np.object_)
    angle = rng.uniform(0.0, 2.0 * np.pi, len(moved))
    place[moved, :2] += 8.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    for k in other.tolist():
        names[k] = rng.choice([c for c in ROUND if c != names[k]])
    kind = np.full(n, "matched", np.object_)
    kind[moved], kind[other], kind[~standing] = "moved", "class", "missing"
    kept = np.setdiff1d(np.arange(n), deleted)
    place[:, :2] += sd * rng.standard_normal((n, 2))
    lat, lon, _ = from_local_ned(place[kept], ORIGIN)
    inventory = Inventory(
        [f"K{k}" for k in kept], names[kept].tolist(), np.asarray(lat), np.asarray(lon),
        world.facing[kept], np.full(len(kept), np.nan),
    )  # fmt: skip
    origin = np.where(standing[kept], kept, -1)
    return Faulty(inventory, origin, kind[kept], set(deleted.tolist()))


def thinned(factor: float) -> None:
    """Let so many times less stand between signs and cameras."""
    global LORRY_SHARE
    LORRY_SHARE /= factor
    for kind in EVERY_M:
        EVERY_M[kind] *= factor


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--drives", type=int, nargs="+", default=[1, 3])
    parser.add_argument("--thinner", type=float, default=1.0, help="times less that hides signs")
    arguments = parser.parse_args()
    thinned(arguments.thinner)
    for drives in arguments.drives:
        rows: dict[str, list[tuple[float, bool, bool]]] = {kind: [] for kind in KINDS}
        wanted = dict.fromkeys(KINDS, 0)
        unseen: list[tuple[float, bool, bool]] = []
        for seed in range(arguments.first, arguments.first + arguments.seeds):
            one = case(seed, drives)
            result = compare_inventory(
                one.signs, one.faulty.inventory, one.drives, left_out=one.left_out
            )
            for kind in KINDS:
                wanted[kind] += due(result, one.faulty, one.truth, kind)
            for finding in result.findings:
                if finding.kind in KINDS:
                    right = correct(finding, one.faulty, one.truth)
                    rows[finding.kind].append((finding.probability, right, finding.sure))
                    if finding.kind == "missing":
                        name = int(one.faulty.inventory.ids[finding.listed][1:])
                        other = right or bool(one.hidden[name])
                        unseen.append((finding.probability, other, finding.sure))
        print(f"{drives} drives, {arguments.seeds} seeds\n  kind       due  told  prec  rec   sure")
        for kind in KINDS:
            print(f"  {kind:8} {wanted[kind]:5}{_scores(rows[kind], wanted[kind])}")
        # those that nobody can have seen are due besides
        more = sum(row[1] for row in unseen) - sum(row[1] for row in rows["missing"])
        print(
            f"  or hidden {wanted['missing'] + more:4}{_scores(unseen, wanted['missing'] + more)}"
        )
        every = np.array([row for kind in KINDS if kind != "matched" for row in rows[kind]])
        for low, high in pairwise((0.0, 0.5, 0.8, 0.9, 0.97, 1.001)):
            part = every[(every[:, 0] >= low) & (every[:, 0] < high)]
            if len(part):
                stated, true, _ = part.mean(axis=0)
                print(f"  stated {stated:.3f}: right {true:.3f} of {len(part)}", flush=True)


def _scores(rows: list[tuple[float, bool, bool]], wanted: int) -> str:
    text = ""
    for only_sure in (False, True):
        told = [right for _, right, sure in rows if sure or not only_sure]
        good = sum(told)
        text += f"  {len(told):5} {good / max(len(told), 1):.2f} {good / max(wanted, 1):.2f}"
    return text


if __name__ == "__main__":
    main()
