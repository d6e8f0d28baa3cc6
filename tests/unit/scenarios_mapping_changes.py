"""Roads, older maps, series of drives, cells of the globe and reviews, part by part."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from automap.records import PlacedSign, ReviewAction, SeenIn, Sign
from tests.unit.figure_levels import levelled, table
from tests.unit.scenarios import scenario

CLASSES = (
    "regulatory--stop--g1",
    "regulatory--yield--g1",
    "warning--children--g2",
    "warning--curve-left--g1",
)


@scenario
def mapping_ways() -> Any:
    """Roads as a graph, a path matched to them, and where signs stand on them."""
    from automap.roads import matching as of
    from tests.unit.test_roads import sign_at

    rng = np.random.default_rng(3)
    lines = [
        np.array([(0.0, 0.0), (0.0, 120.0), (0.0, 120.0), (8.0, 160.0)]),
        np.array([(-80.0, 118.0), (0.2, 120.1), (140.0, 130.0)]),
        np.array([(12.0, 0.0), (12.0, 110.0), (30.0, 150.0)]),
        np.array([(140.1, 129.9), (150.0, 30.0)]),
    ]
    oneway = np.array([0, 1, -1, 0])
    network = of.build_network(lines, np.array([5.0, 100.0, 0.0, 33.0]), oneway)
    plain = of.build_network(lines[:2], np.zeros(2))
    corners = np.array([(1.0, 5.0), (2.0, 118.0), (138.0, 129.0), (149.0, 40.0)])
    size = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    at = np.arange(0.0, size[-1], 4.0)
    xy = np.column_stack([np.interp(at, size, corners[:, k]) for k in range(2)])
    xy += np.cumsum(rng.normal(0.0, 0.35, xy.shape), axis=0)
    yaw = np.arctan2(*np.gradient(xy, axis=0).T) + 0.05 * rng.normal(size=len(xy))
    yaw[7:12] = np.nan
    lost = xy.copy()
    lost[30:33] = np.nan
    sd = rng.uniform(0.5, 2.5, len(xy))
    sd[4] = np.nan
    ways = [of.match_path(xy, yaw, sd, n) for n in (network, plain)]
    ways.append(of.match_path(lost, -yaw, sd, network))
    sigma = np.hypot(np.nan_to_num(sd, nan=2.0), of.LAYER_SD_M)
    time = 2.0 * np.arange(len(ways[0].xy))
    signs = [
        (rng.uniform([-10.0, 0.0], [160.0, 140.0]), sign_at(0.0, 0.0, a))
        for a in np.arange(-3.0, 3.1, 0.4)
    ]
    windows = [(np.nan, np.nan), (5.0, 30.0), (40.0, 41.0), (900.0, 950.0)]
    return levelled(
        {
            "networks": (network, plain),
            "ways": ways,
            "candidates": of._candidates(xy, np.nan_to_num(yaw), sigma, network),
            "feet": of._project(xy[:12], network, np.arange(12) % len(network.size)),
            "on": [
                of._on_road(place, sign, windows[k % 4], time, ways[0], network)
                for k, (place, sign) in enumerate(signs)
            ],
            "near": [
                of._on_road(
                    ways[0].xy[k] + [2.0, -3.0 + k / 5.0], sign, windows[0], time, ways[0], network
                )
                for k, (_, sign) in enumerate(signs)
            ],
        }
    )


def _signs(rng: np.random.Generator, n: int) -> list[Sign]:
    root = 0.3 * rng.normal(size=(n, 3, 3))
    return [
        Sign(
            id=f"s{k}",
            class_name=CLASSES[k % 4],
            lat_rad=-0.61 + 2e-6 * k + 3e-7 * (k % 3),
            lon_rad=2.6 + 1.5e-6 * (k % 5),
            height_m=580.0 + k,
            cov_enu=root[k] @ root[k].T + 0.1 * np.eye(3),
            confidence=0.5 + 0.02 * k,
            n_views=3 + k,
            first_seen_ns=10**9 * k,
            last_seen_ns=10**9 * (k + 3),
            height_above_road_m=2.0 + 0.1 * k,
            facing_rad=0.4 * k if k % 6 else float("nan"),
            size_m=0.6 + 0.01 * k,
            side="left",
            status="ok",
            drives=(f"d{k % 3}",),
            existence=0.9,
        )
        for k in range(n)
    ]


@scenario
def mapping_older() -> Any:
    """Signs of two maps: shared sightings, costs, the same and the moved ones."""
    from automap.mapping import changes as of
    from automap.mapping import limits

    rng = np.random.default_rng(7)
    older = _signs(rng, 14)
    signs = [
        replace(
            s,
            lat_rad=s.lat_rad + 1.2e-7 * rng.normal(),
            lon_rad=s.lon_rad + 1.2e-7 * rng.normal(),
            facing_rad=s.facing_rad + 0.2 * rng.normal(),
            class_name=CLASSES[(k + 1) % 4] if k in (3, 8) else s.class_name,
        )
        for k, s in enumerate(older)
    ]
    for k in (5, 9):
        signs[k] = replace(signs[k], lat_rad=signs[k].lat_rad + 1.3e-6)
    members = {f"k{k}": f"s{k // 2}" for k in range(16)}
    before = of.OlderMap(older, members)
    keys = [[f"k{j}" for j in range(3 * k, 3 * k + 4)] for k in range(6)]
    shared = of.shared_sightings(before, keys)
    rows, old = list(range(2, 14)), list(range(0, 14))
    return levelled(
        {
            "shared": sorted((*key, count) for key, count in shared.items()),
            "same": [of.match_older(older, signs, each) for each in (shared, {})],
            "moved": of.match_moved(older, [3, 4, 5, 8, 9], signs, [5, 9, 8, 3]),
            "costs": [
                np.array(of._costs(signs, rows, older, old, reach, far))
                for reach, far in ((limits.SAME_PLACE_M, False), (12.0, True))
            ],
            "none": of._costs(signs, [], older, old, 9.0, True),
            "apart": [of.distance_m(a, b) for a, b in zip(signs, older, strict=True)],
        }
    )


@scenario
def mapping_series() -> Any:
    """Many drives of one street: classes that change, what all say together."""
    from automap.mapping import attributes as of
    from automap.mapping.association import associate
    from automap.mapping.sightings import stack_sightings
    from tests.unit.merge_scene import Errors, street_scene

    errors = Errors(shared=(0.9, 0.7, 1.1), own_across=0.25, missed=0.05, clutter=0.0)
    stacked = stack_sightings(street_scene(21, 7, 200.0, 9.0, errors).drives)
    found = associate(stacked)
    rng = np.random.default_rng(5)
    late = (stacked.drive >= 3) & (found % 4 == 1) | (stacked.drive >= 5) & (found % 4 == 2)
    stacked = replace(
        stacked,
        code=np.where(late, (stacked.code + 1) % len(stacked.classes), stacked.code),
        confidence=rng.uniform(0.2, 0.98, len(stacked)),
        facing_sd_rad=rng.uniform(0.05, 0.3, len(stacked)),
        class_probability=rng.uniform(0.4, 0.99, len(stacked)),
        contrast=np.where(rng.random(len(stacked)) < 0.6, np.nan, rng.random(len(stacked))),
        contrast_note=np.array(["dark", "", "too small"], object)[rng.integers(0, 3, len(stacked))],
        status=np.array(["far", "implausible", "weak_geometry"], object)[
            rng.integers(0, 3, len(stacked))
        ],
        side=np.array(["left", "right", ""], object)[rng.integers(0, 3, len(stacked))],
    )
    drives = np.array([0, 0, 1])
    states = [
        np.array(s, object)
        for s in (
            ["far", "ok", "far"],
            ["far", "far", "implausible"],
            ["far", "weak", "weak"],
            ["doubtful"] * 3,
            ["", "", ""],
        )
    ]
    return levelled(
        {
            "attributes": vars(of.combine_attributes(stacked, found)),
            "status": [of._status(s, d) for s in states for d in (drives, 0 * drives)],
            "most": of._most(
                np.array(["b", "a", "", "b", "c"], object), np.array([1.0, 1.5, 9.0, 0.4, 1.45])
            ),
        }
    )


@scenario
def mapping_globe() -> Any:
    """Cells at the poles, at the date line and beside one another."""
    from automap.mapping import cells as of

    rng = np.random.default_rng(4)
    lat = np.concatenate([rng.uniform(-0.7, 0.7, 8), [1.4843, 1.4844, 1.57, -1.4843, -1.5, 1.2]])
    lon = np.concatenate(
        [rng.uniform(-3.1, 3.1, 8), [0.3, 3.14159, -2.0, -3.14159, 1.0, -3.1415926]]
    )
    cell = of.cell_of(lat, lon)
    wide = 2.0e3
    many = np.unique(np.concatenate([[c + k for k in (-1, 0, 1, 2)] for c in cell.tolist()]))
    return levelled(
        {
            "cell": cell,
            "key": [of.quadkey(int(c)) for c in cell],
            "named": [of.cell_named(of.quadkey(int(c))) for c in cell],
            "colour": [of.colour_of(int(c)) for c in many],
            "meets": [
                of.meets(int(c), of.squares(lat, lon, m)) for c in cell for m in (10.0, wide, 3e4)
            ],
            "squares": [tuple(of.squares(lat, lon, m)) for m in (1.0, wide, 1e5)],
            "beside": [of.beside(int(c), m) or "many" for c in cell for m in (wide, 9e3)],
            "reach": [of._reach(row, m) for row in (0, 1000, 8000, 16000) for m in (wide, 9e3)],
            "groups": [(c, s.start, s.stop) for c, s in of.groups(np.array([3, 3, 5, 9, 9, 9]))],
            "rows": (of._row(lat), of._column(lon)),
        }
    )


@scenario
def mapping_review() -> Any:
    """Every kind of action on signs that were renumbered, and what becomes of their views."""
    from automap.review import reviewed as of
    from automap.review import verdicts as folded

    signs = _signs(np.random.default_rng(9), 12)

    def action(number: int, sign: str, kind: Any, **more: Any) -> ReviewAction:
        told = {}
        if sign in (own := {s.id: s for s in signs}):
            s = own[sign]
            told = {
                "seen_class": s.class_name,
                "seen_lon_deg": float(np.degrees(s.lon_rad)),
                "seen_lat_deg": float(np.degrees(s.lat_rad)),
            }
        time, who = f"2026-01-{number + 1:02d}", ("ann", "bob")[number % 2]
        return ReviewAction(f"a{number}", time, sign, kind, **({"reviewer": who} | told | more))

    def other(sign: str) -> dict[str, Any]:
        s = {each.id: each for each in signs}[sign]
        return {
            "other": sign,
            "other_seen_class": s.class_name,
            "other_seen_lon_deg": float(np.degrees(s.lon_rad)),
            "other_seen_lat_deg": float(np.degrees(s.lat_rad)),
        }

    lon, lat = float(np.degrees(2.6)), float(np.degrees(-0.61))
    place = PlacedSign(
        lon_deg=lon + 1e-5,
        lat_deg=lat - 2e-5,
        cov_m2=(0.4, 0.1, 0.5, 0.9),
        height_m=577.0,
        height_above_road_m=2.7,
        sd_above_road_m=0.2,
        size_m=0.8,
        facing_deg=123.0,
        facing_sd_deg=9.0,
        side="right",
        n_views=4,
        first_seen_ns=5,
        last_seen_ns=99,
    )
    bare = replace(
        place,
        height_m=float("nan"),
        height_above_road_m=float("nan"),
        facing_deg=float("nan"),
        n_views=0,
        side="",
        cov_m2=(1.4, -0.3, 0.7, 2.0),
    )
    views = (SeenIn("d1", "front", 3), SeenIn("d2", "left", 8))
    actions = [
        action(0, "s0", "accept"),
        action(1, "s0", "reject"),
        action(2, "s1", "correct", class_name=CLASSES[3], lon_deg=lon, lat_deg=lat, sd_m=0.7),
        action(3, "s1", "note", note="leans"),
        action(
            4, "s2", "correct", facing_deg=-30.0, height_above_road_m=3.4, lon_deg=lon, lat_deg=lat
        ),
        action(5, "s3", "split", views=views, place=place, other="new1", other_place=bare),
        action(6, "s4", "merge", place=bare, **other("s5")),
        action(7, "add1", "add", place=place, views=views[:1], seen_class=CLASSES[2]),
        action(8, "s6", "reject"),
        action(9, "s6", "undo", undoes="a8"),
        action(10, "s7", "reject", note="gone"),
        action(11, "s7", "reset"),
        action(12, "s8", "accept"),
        action(13, "s8", "correct", class_name=CLASSES[1], settles=True),
        action(14, "lost", "accept", seen_class=CLASSES[0], seen_lon_deg=9.0, seen_lat_deg=9.0),
        action(15, "add2", "add", place=bare, seen_class=CLASSES[1]),
        action(16, "add2", "undo", undoes="a15"),
        action(17, "new1", "correct", class_name=CLASSES[0], seen_class=CLASSES[1]),
        action(18, "s10", "correct", class_name=CLASSES[1]),
        action(19, "s10", "reject"),
        *(
            action(
                20 + k,
                f"gone{k}",
                "accept",
                seen_class=CLASSES[0],
                seen_lon_deg=8.0,
                seen_lat_deg=7.0,
            )
            for k in range(6)
        ),
    ]
    # a later run: numbers moved by two, all a metre further on
    later = [replace(s, id=f"s{k + 2}", lat_rad=s.lat_rad + 1e-7) for k, s in enumerate(signs)]
    state = folded.verdicts(actions)
    decided = [v for v in state.values() if not v.created]
    places = [np.degrees([getattr(s, n) for s in later]) for n in ("lon_rad", "lat_rad")]
    names = [s.class_name for s in later]
    found: dict[str, Any] = {}
    for name, these, some in (
        ("now", signs, actions),
        ("later", later, actions),
        ("few", signs, actions[:16]),
    ):
        after = of.apply_review(these, some)
        renamed = after.renamed
        found[name] = {
            "signs": table(after.signs),
            "rejected": [s.id for s in after.rejected],
            "problems": after.problems,
            "single": sorted(map(str, renamed.single.items())),
            "whole": sorted(renamed.whole.items()),
            "named": [
                renamed.name_of(sign, *view)
                for sign in ("s3", "s5", "s7", "s9")
                for view in (("front", 3), ("front", 3, "d1"), ("left", 8, "d1"), ("left", 9, "d2"))
            ],
        }
    return levelled(
        found
        | {
            "state": table(list(state.values())),
            "standing": [a.id for a in folded.standing(actions)],
            "rows": [str(r) for r in of.match(decided, [s.id for s in later], names, *places)],
            "apart": [of._distance_m(v, *places) for v in decided[:3]],
        }
    )
