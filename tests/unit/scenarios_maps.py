"""Signs of a drive located, and drives merged into a map, compared with lists and older maps."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from tests.unit.scenarios import scenario


@scenario
def mapping_street() -> Any:
    """A street that three drives passed, merged; which class, which face, what is there."""
    from automap.mapping.merge import merge_drives
    from tests.unit.merge_scene import street_scene

    scene = street_scene(3, 4, 260.0)
    merged = merge_drives(scene.drives)
    return replace(merged, drives=[])


@scenario
def mapping_crowded() -> Any:
    """Signs close to each other, with much clutter and many wrong classes."""
    from automap.mapping.merge import merge_drives
    from automap.mapping.posts import with_supports
    from tests.unit.merge_scene import Errors, street_scene

    errors = Errors(clutter=0.3, wrong_class=0.3, missed=0.3, own_across=0.6)
    merged = merge_drives(street_scene(8, 3, 120.0, 8.0, errors).drives)
    posts = with_supports(merged.signs, np.full((len(merged.signs), 2), 0.3))
    return {"merged": replace(merged, drives=[]), "posts": posts}


@scenario
def compare_inventories() -> Any:
    """A map against an inventory with faults."""
    from automap.inventory.comparison import compare_inventory
    from tests.unit.inventory_case import faulty, merged_town, town_and_drive
    from tests.unit.merge_scene import USUAL

    found = {}
    for name, case in {
        "one": town_and_drive(1, 500.0, USUAL),
        "three": merged_town(2, 3, 300.0, USUAL),
    }.items():
        rng, town, drives, _, signs = case
        found[name] = compare_inventory(signs, faulty(rng, town).inventory, drives)
    return found


@scenario
def mapping_roads() -> Any:
    """Signs along a path over crossing roads."""
    from automap.roads.matching import road_positions
    from tests.unit.test_roads import driven, layer, sign_at

    rng = np.random.default_rng(3)
    roads = layer(
        [(0.0, 0.0), (0.0, 120.0), (8.0, 160.0)],
        [(-80.0, 118.0), (0.0, 120.0), (140.0, 130.0)],
        [(12.0, 0.0), (12.0, 110.0)],
        [(140.0, 130.0), (150.0, 30.0)],
    )
    corners = [(1.0, 5.0), (2.0, 118.0), (138.0, 129.0), (149.0, 40.0)]
    error = np.cumsum(rng.normal(0.0, 0.5, (len(driven(corners).gps_s), 2)), axis=0)
    path = driven(corners, error)
    signs = [
        sign_at(*rng.uniform([-10.0, 0.0], [160.0, 140.0]), rng.uniform(-3.0, 3.0), "right")
        for _ in range(10)
    ]
    return road_positions(path, roads, signs, [(np.nan, np.nan)] * 4 + [(0.0, 12.0)] * 6)


@scenario
def mapping_cells() -> Any:
    """Cells of the world, who touches them, and tiles."""
    from automap.mapping.cells import cell_of, colour_of, meets, quadkey, squares
    from automap.mapping.tiles import cut_tiles

    rng = np.random.default_rng(6)
    lat, lon = rng.uniform(-0.62, -0.61, 60), rng.uniform(2.6, 2.61, 60)
    cell = cell_of(lat, lon)
    return {
        "cell": cell,
        "colour": [colour_of(int(c)) for c in cell],
        "key": [quadkey(int(c)) for c in cell[:5]],
        "meets": [meets(int(c), squares(lat, lon, 300.0)) for c in np.unique(cell)],
        "tiles": list(cut_tiles(lat, lon, 7, 150.0)),
    }


@scenario
def geolocation_street() -> Any:
    """A street with a turned, late camera; signs as a whole drive gives them."""
    from automap.geolocation.locate import locate_signs
    from tests.unit import geolocation_scene as world

    path = world.drive_path(13.0)
    scene = world.roadside(path, every_s=2.0)
    true = world.camera(time_offset_s=0.02, mount_rpy=np.radians([0.7, -0.8, 2.4]))
    found, _ = world.boxes(path, scene, true, np.random.default_rng(3), interval_s=0.4)
    located = locate_signs(path, [found], {"front": world.camera()})
    return vars(replace(located, adjusted=None, corrections=_without_rounding(located)))


def _without_rounding(located: Any) -> Any:
    """Cameras' corrections; a time offset that is no more than what iterations end at is zero."""
    return {
        name: replace(found, time_s=round(found.time_s, 6))
        for name, found in located.corrections.items()
    }


@scenario
def geolocation_control() -> Any:
    """A path that is off, put right by control signs."""
    from automap.geolocation.locate import locate_signs
    from tests.unit import geolocation_scene as world
    from tests.unit.test_geolocation_adjustment import SHIFT, moved, surveyed

    path = world.drive_path(12.0)
    scene = world.roadside(path, every_s=2.0)
    rng = np.random.default_rng(0)
    found, _ = world.boxes(path, scene, world.camera(), rng, 0.5, interval_s=0.5)
    control = surveyed(scene, list(range(0, len(scene.position), 2)))
    off = moved(path, SHIFT, 3.0)
    located = locate_signs(off, [found], {"front": world.camera()}, control=control)
    corrections = _without_rounding(located)
    (adjusted,) = located.adjusted.pieces()  # type: ignore[union-attr]
    return {**vars(located), "adjusted": adjusted, "corrections": corrections}


@scenario
def geolocation_bearings() -> Any:
    """Lamps from bearings with and without depths, and the scale of depths."""
    from automap.geolocation.bearings import BearingRules, locate_from_bearings
    from automap.geolocation.depth_scale import fit_depth_scale
    from tests.unit.test_geolocation_bearings import sightings

    lamps = np.array([[20.0, 9.0], [45.0, -8.0], [47.0, -4.0], [80.0, 10.0]])
    cameras = np.column_stack([np.arange(0.0, 100.0, 8.0), np.zeros(13)])
    rng = np.random.default_rng(2)
    with_depth, _ = sightings(lamps, cameras, rng)
    without, _ = sightings(lamps, cameras, rng, with_depth=False, bearing_sd_deg=0.5)
    measured, rough = rng.uniform(3.0, 40.0, 50), np.exp(rng.normal(0.0, 0.2, 50))
    return {
        "with": locate_from_bearings(with_depth),
        "without": locate_from_bearings(without, BearingRules(single=True)),
        "scale": fit_depth_scale(
            measured,
            2.0 + 1.3 * measured * rough,
            np.full(50, 0.2),
            BearingRules(depth_offset_sd_m=3.0, depth_scale_log_sd=0.5),
        ),
    }


@scenario
def geolocation_course() -> Any:
    """The path's relation to places, and a camera's first turn by pairs of boxes."""
    from automap.geolocation.epipolar import first_correction
    from automap.geolocation.path_relation import make_path, roads_at, side_of_path
    from tests.unit import geolocation_scene as world

    path = world.drive_path(16.0)
    scene = world.roadside(path, every_s=2.0)
    turned = world.camera(mount_rpy=np.radians([0.5, -1.5, 4.0]), time_offset_s=0.05)
    found, _ = world.boxes(path, scene, turned, np.random.default_rng(1), interval_s=0.5)
    plain = world.camera(mount_sd=np.radians(3.0), time_offset_sd=0.1)
    way = make_path(path, world.ORIGIN)
    first, last = int(path.t_ns[0]), int(path.t_ns[-1])
    places = scene.position
    return {
        "first": first_correction(path, found, plain, world.ORIGIN, 2e-3),
        "relation": [roads_at(way, p, first, last)[0, 3:].tolist() for p in places],
        "course": [roads_at(way, p, first, last)[:, :4] for p in places],
        "side": [side_of_path(a, b) for a in (-9.0, -0.5, 0.5, 9.0) for b in (1.0, 6.0)],
    }


@scenario
def mapping_changes() -> Any:
    """A map of three drives against one of two, and what its review leaves of it."""
    from automap.mapping.changes import OlderMap
    from automap.mapping.compare import compare_maps
    from automap.mapping.merge import merge_drives
    from tests.unit.merge_scene import street_scene

    scene = street_scene(2, 5, 260.0)
    older = merge_drives(scene.drives[:2])
    newer = merge_drives([*scene.drives[:1], *scene.drives[2:]])
    ids = [f"o{k}" for k in range(len(older.signs))]
    members = {key: name for name, keys in zip(ids, older.keys, strict=True) for key in keys}
    signs = [replace(s, id=name) for s, name in zip(older.signs, ids, strict=True)]
    signs[1] = replace(signs[1], class_name="warning--children--g2")
    signs[2] = replace(signs[2], lat_rad=signs[2].lat_rad + 2e-6)
    return {
        "by sightings": compare_maps(OlderMap(signs, members), newer),
        "by place": compare_maps(OlderMap(signs[:-1]), newer),
    }


@scenario
def geolocation_tracks() -> Any:
    """Tracks with boxes of other signs in them, cleaned; what they leave, linked anew."""
    from automap.geolocation.landmark import SizePrior
    from automap.geolocation.splitting import clean_tracks
    from automap.geolocation.tracking import link_views
    from automap.geolocation.views import MeasurementNoise, build_views
    from tests.unit import geolocation_scene as world

    path = world.drive_path(14.0)
    scene = world.roadside(path, every_s=2.0)
    found, owner = world.boxes(path, scene, world.camera(), np.random.default_rng(2))
    views = build_views(path, [found], {"front": world.camera()}, MeasurementNoise())
    prior = SizePrior()
    of = [np.flatnonzero(owner == k) for k in np.unique(owner)]
    long = [rows for rows in of if len(rows) >= 6][:3]
    mixed = [
        np.sort(np.concatenate([long[0], long[1][:2]])),
        np.sort(np.concatenate([long[2], long[0][:1], long[1][2:3]])),
    ]
    marks, misfits = clean_tracks(views, mixed, prior, 20.0)
    pieces, _ = clean_tracks(views, [long[1][:4], long[1][4:], long[2]], prior, 20.0)
    return {
        "linked": link_views(views, prior, 20.0),
        "cleaned": marks,
        "misfits": misfits,
        "pieces": pieces,
    }
