"""Objects from bearings, networks of passes and the faces of signs, part by part."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from automap.earth import from_local_ned
from automap.records import Bearings, Detections
from tests.unit.figure_levels import levelled, table
from tests.unit.geolocation_drive import CLASSES, CORRECTIONS, PRIOR, rich_drive
from tests.unit.scenarios import scenario
from tests.unit.scenarios_geolocation import _landmarks, _seen

HERE = (-0.6161, 2.6023, 0.0)


def _bearings(seed: int) -> Bearings:
    """Sightings of a dozen objects, some of them close, from two streets; a third has no depth."""
    rng = np.random.default_rng(seed)
    objects = rng.uniform([-5.0, -14.0], [90.0, 16.0], (9, 2))
    objects[5] = objects[4] + [1.4, 0.6]
    objects[7] = objects[6] + [-2.2, 3.1]
    cameras = np.vstack(
        [
            np.column_stack([np.arange(0.0, 90.0, 7.0), rng.normal(0.0, 0.4, 13)]),
            np.column_stack([rng.normal(40.0, 0.4, 6), np.arange(-28.0, 25.0, 9.0)]),
        ]
    )
    offset = objects[None] - cameras[:, None]
    distance = np.hypot(offset[..., 0], offset[..., 1])
    camera, thing = np.nonzero(
        (distance < 33.0) & (distance > 2.5) & (rng.random(distance.shape) < 0.8)
    )
    n = len(camera)
    there = offset[camera, thing]
    lat, lon, _ = from_local_ned(np.column_stack([cameras[camera], np.zeros(n)]), HERE)
    depth = (distance[camera, thing] - 1.5) / 1.25 * np.exp(rng.normal(0.0, 0.2, n))
    depth[rng.random(n) < 0.3] = np.nan
    depth[3] = -1.0
    sd = np.radians(rng.uniform(0.8, 2.5, n))
    sd[rng.random(n) < 0.2] = np.nan
    return Bearings(
        lat_rad=lat,
        lon_rad=lon,
        bearing_rad=np.arctan2(there[:, 1], there[:, 0]) + rng.normal(0.0, 0.025, n),
        depth_m=depth,
        class_name=np.array([("lamp", "post", "")[k % 3] for k in thing], object),
        sd_rad=sd,
    )


@scenario
def geolocation_rays() -> Any:
    """Rays and points, their costs, the least set of objects, and the scale of depths."""
    from automap.geolocation import bearing_cover as cover
    from automap.geolocation import bearing_rays as of
    from automap.geolocation import bearings
    from automap.geolocation.depth_scale import DepthScale, fit_depth_scale

    rng = np.random.default_rng(12)
    told = _bearings(3)
    rules = of.BearingRules(0.03, 0.7, 0.25, 2.0, 0.4, True, 28.0, 6.5, 5.0, 1.2)
    rays = of.in_plane(told, rules, HERE)
    points = rng.uniform([0.0, -12.0], [85.0, 14.0], (9, 2))
    some = np.arange(0, len(rays.centre), 3)
    places = cover.candidates(rays, rules)
    first = cover.cover(rays, places, rules)
    near = first[0] + rng.normal(0.0, 1.5, first[0].shape)
    mixed = first[1].copy()
    mixed[::6] = (mixed[::6] + 1) % len(first[0])
    twice = np.vstack([first[0], first[0][:4] + np.array([0.5, -0.4])])
    halves = np.where((mixed < 4) & (np.arange(len(mixed)) % 2 == 0), mixed + len(first[0]), mixed)
    halves[mixed < 0] = -1
    spread = of.BearingRules(depth_offset_sd_m=2.5, depth_scale_log_sd=0.4)
    measured = rng.uniform(3.0, 40.0, 30)
    away = np.maximum(1.7 + 1.3 * measured, 1.0) * np.exp(rng.normal(0.0, 0.3, 30))
    return levelled(
        {
            "rays": rays,
            "costs": of.costs(rays, some, points, rules),
            "equations": [
                of.normal_equations(rays, some[k : k + 5], points[k], rules) for k in (0, 4)
            ],
            "points": [
                of.fit_point(rays, rays_of, start, rules)
                for rays_of, start in (
                    (some[2:5], points[1]),
                    (some[6:7], points[3]),
                    (np.flatnonzero(mixed == 2), near[2]),
                )
            ],
            "candidates": places,
            "best": [cover._best_set(rays, some, p, rules) for p in first[0][:5]],
            "cover": first,
            "moved": cover.reassign(rays, near, mixed, rules),
            "compact": cover._compact(rays, twice, halves, rules),
            "scale": bearings._depth_scale(rays, *first, rules),
            "single": bearings._without_single(*first),
            "signs": table(bearings._signs(told, rays, *first, rules, HERE, "round")[0]),
            "all": [
                (table(signs), owner)
                for signs, owner in (
                    bearings.locate_from_bearings(told, replace(rules, single=False)),
                )
            ],
            "none": bearings.locate_from_bearings(
                replace(told, **{n: v[:0] for n, v in vars(told).items()})
            ),
            "fit": [
                fit_depth_scale(measured, away, s * rng.uniform(0.1, 0.3, 30), spread)
                for s in (1.0, 3.0)
            ],
            "apply": DepthScale(-3.0, 1.4).apply(np.array([1.0, 2.5, 9.0, np.nan])),
        }
    )


@scenario
def geolocation_network() -> Any:
    """Errors of paths that see the same signs, in one to three axes, with strays."""
    from automap.mapping.path_errors import Equations, Network
    from automap.robust import cauchy_weight

    found: dict[str, Any] = {}
    for axes in (1, 2, 3):
        rng = np.random.default_rng(axes)
        time = np.concatenate([np.sort(rng.uniform(0.0, 90.0, n)) for n in (7, 5, 4)])
        step = np.diff(time, prepend=np.inf)
        alike = np.where(step < 0.0, 0.0, np.exp(-np.abs(step) / 23.0))
        node = rng.integers(0, 16, 19)
        sign = np.concatenate([np.arange(6), rng.integers(0, 6, 13)])
        root = rng.normal(size=(19, axes, axes))
        network = Network(
            alike,
            node[:, None],
            sign,
            rng.uniform(0.3, 1.2, (19, 1, axes)),
            3.0 * rng.normal(size=(19, axes)),
            root @ np.swapaxes(root, 1, 2) + 0.4 * np.eye(axes),
        )
        equations = Equations(network)
        whole = equations.solve()
        part = Equations(network, equations.order).solve(rng.uniform(0.2, 1.5, 19))
        solved = [
            {n: v for n, v in vars(each).items() if n != "factor"}
            | {
                "variances": each.factor.inverse_at(*2 * (np.arange(each.error.size),)).reshape(
                    each.error.shape
                )
            }
            | ({"places": each.place_variances(4)} if axes < 3 else {})
            for each in (whole, part)
        ]
        weights = [equations.weights(cauchy_weight, rounds) for rounds in (1, 3, 30)]
        found[str(axes)] = {"alike": alike, "solved": solved, "weights": weights}
    return levelled(found)


@scenario
def geolocation_faces() -> Any:
    """What widths tell of normals, belief by belief, and what the boxes tell of a face's state."""
    from automap.geolocation import condition
    from automap.geolocation import facing as of
    from automap.geolocation.path_relation import (
        make_path,
        roads_at,
        side_of_path,
    )

    drive, rng = rich_drive(), np.random.default_rng(14)
    views = drive.views()
    turned = replace(
        views,
        log_aspect=np.where(
            np.arange(len(views)) % 13 == 0,
            np.nan,
            views.log_aspect + rng.normal(-0.1, 0.06, len(views)),
        ),
    )
    slow = replace(
        drive.path, vel_ned=drive.path.vel_ned * np.linspace(0.0, 1.0, len(drive.path))[:, None]
    )
    path = make_path(slow, views.origin)
    seen = _seen(views, range(2, 10))
    observed = [of._observed(turned, seen[k : k + 2], path) for k in range(0, 12, 2)]
    faces = of.Faces(0.3, 0.07, rng.normal(0.0, 0.03, 8), 0.05, 1.2, 1.1)
    believed = [
        of._believe(one, f) for one, f in zip(observed, [faces, of.Faces()] * 3, strict=True)
    ]
    first, last = int(drive.path.t_ns[300]), int(drive.path.t_ns[900])
    rows = drive.rows(views, 8)
    notes = ["too small", "dark", "", "too small", "blurred", "dark", "too small"]
    contrast = np.array([0.2, 0.5, np.nan, 0.3, 0.41, 0.9, 0.35])
    heights = np.array([0.01, 0.03, 0.09, 0.02, 0.033, 0.011, 0.04])
    return levelled(
        {
            "observed": observed,
            "prior": [of._prior(one, faces) for one in observed[:2]],
            "believed": believed,
            "common": of._common(observed),
            "summary": [of._summary(o, b) for o, b in zip(observed, believed, strict=True)],
            "expected": {
                shape: of.expected_aspect(views, rows[:3], np.linspace(-3.0, 3.0, 9), shape)
                for shape in ("circle", "square", "triangle-up", "diamond", "octagon")
            },
            "path": path,
            "relation": [roads_at(path, p, first, last) for p in drive.place],
            "side": [
                side_of_path(a, b) for a in (-4.0, -1.0, 0.0, 2.9, 3.1) for b in (3.0, 4.6, 6.0)
            ],
            "face": [
                condition.face_of_views(contrast[:n], notes[:n], heights[:n]) for n in (7, 4, 1)
            ]
            + [condition.face_of_views(np.full(7, np.nan), notes[k:], heights) for k in (0, 6)],
        }
    )


@scenario
def geolocation_start() -> Any:
    """Cameras of which little is known, from the boxes alone and from all signs."""
    from automap.geolocation import camera_estimate as of
    from automap.geolocation.rules import GeolocationRules

    drive = rich_drive()
    rules = GeolocationRules(noise=replace(GeolocationRules().noise, pixel_sd=1.1), size=PRIOR)
    loose = {n: replace(c, mount_sd=0.03, time_offset_sd=0.02) for n, c in drive.cameras.items()}
    late: list[Detections] = [
        replace(d, t_ns=d.t_ns + np.int64(25_000_000)) for d in drive.detections
    ]
    views = drive.views()
    marks = _landmarks(views, (5, 6, 8, 9, 10, 12))
    correction = CORRECTIONS["front"]
    return levelled(
        {
            "first": of.first_corrections(drive.path, late, loose, rules),
            "sure": of.first_corrections(drive.path, late, drive.cameras, rules).keys(),
            "estimated": of.estimate_cameras(drive.path, late, loose, {}, marks, views, rules),
            "given": of._time_as_given(correction, loose["front"], (0.1, 0.4), rules),
            "settled": [
                of._settled(correction, replace(correction, time_s=0.004 + step))
                for step in (1e-6, 1e-3, -1e-3)
            ],
            "refit": of.refit(
                views, [views.row[m.rows][::-1] for m in marks[:2]] + [np.array([10**6])], rules
            ),
            "classes": list(CLASSES),
        }
    )
