"""Parts of the mapping one by one, on a street where drives tell all that they may, or not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from automap.records import FloatArray
from tests.unit.figure_levels import levelled, table
from tests.unit.scenarios import scenario


@cache
def _drives(length_m: float = 230.0) -> list[Any]:
    """Four drives of a street; one tells no path, one no probabilities, some cells are unknown."""
    from automap.mapping.sightings import CameraView
    from tests.unit.merge_scene import Errors, street_scene

    errors = Errors(clutter=0.15, wrong_class=0.15, missed=0.2, own_across=0.3)
    drives = street_scene(12, 4, length_m, 11.0, errors).drives
    rng = np.random.default_rng(3)
    told = []
    for k, drive in enumerate(drives):
        n = len(drive)
        some = rng.random(n) < 0.2
        root = 0.2 * rng.normal(size=(n, 3, 3))
        notes = np.array(["", "dark", "too small"], object)[rng.integers(0, 3, n)]
        drive = replace(
            drive,
            cov_enu=drive.cov_enu + root @ np.swapaxes(root, 1, 2),
            height_m=np.where(some, np.nan, drive.height_m),
            facing_rad=np.where(rng.random(n) < 0.15, np.nan, drive.facing_rad),
            facing_sd_rad=rng.uniform(0.05, 0.4, n),
            sd_above_road_m=rng.uniform(0.05, 0.4, n),
            size_m=rng.uniform(0.4, 0.9, n),
            status=np.array(["ok", "far", "single_view"], object)[rng.integers(0, 3, n)],
            side=np.array(["left", "right"], object)[rng.integers(0, 2, n)],
            cameras=(CameraView(0.1, 0.5), CameraView(-0.9, 0.3)) if k != 1 else drive.cameras,
        )
        if k != 2:
            drive = replace(
                drive,
                class_probability=np.where(some, np.nan, rng.uniform(0.5, 0.99, n)),
                group_probability=np.where(some, np.nan, rng.uniform(0.7, 0.99, n)),
                existence=np.where(some, np.nan, rng.uniform(0.3, 0.99, n)),
                path_offset_m=np.linspace(-5.0, 5.0, n),
                contrast=np.where(rng.random(n) < 0.3, np.nan, rng.uniform(0.1, 0.8, n)),
                contrast_sd=rng.uniform(0.01, 0.1, n),
                contrast_note=notes,
                seen_share=rng.uniform(0.2, 1.0, n),
                n_looked=rng.integers(0, 20, n).astype(np.float64),
                n_back_views=rng.integers(0, 3, n).astype(np.float64),
            )
        told.append(drive)
    told[3] = replace(told[3], path=None)
    bad = told[0].cov_enu.copy()
    bad[0], bad[1, 2, 2], bad[2, 0, 1] = np.nan, -1.0, 50.0
    told[0] = replace(told[0], cov_enu=bad)
    return told


@scenario
def mapping_association() -> Any:
    """Sightings stacked, associated, joined, and what joins them."""
    from automap.mapping import sightings as seen
    from automap.mapping.adjustment import offsets_of
    from automap.mapping.association import associate, renumbered
    from automap.mapping.by_cells import associate_by_cells
    from automap.mapping.classes import class_evidence

    drives = _drives()
    rows = np.arange(len(drives[0]))
    stacked = seen.stack_sightings(drives)
    found = associate(stacked)
    split = found.copy()
    split[1::5] += int(split.max()) + 1
    cut = renumbered(split)
    return levelled(
        {
            "stacked": stacked,
            "some": stacked.at(np.array([1, 4, 5, 17])).first,
            "none": seen.stack_sightings([]).first,
            "order": seen.canonical_order([drives[k] for k in (2, 0, 3, 1)]),
            "shared": [seen.shared_sd(d, rows[:4]) for d in drives],
            "split": seen.split_covariance(
                drives[0].cov_enu, 0.7 * seen.shared_sd(drives[0], rows)
            ),
            "found": found,
            "again": [associate(stacked, each, offsets_of(stacked, each)) for each in (found, cut)],
            "by cells": associate_by_cells(stacked),
            "evidence": class_evidence(stacked.classes),
        }
    )


@scenario
def mapping_places() -> Any:
    """Signs placed tile by tile, levels of errors, attributes, probabilities and names."""
    from automap.mapping import adjustment as of
    from automap.mapping import sureness
    from automap.mapping.association import Members
    from automap.mapping.attributes import combine_attributes
    from automap.mapping.backs import backs, with_backs
    from automap.mapping.by_cells import joined_signs
    from automap.mapping.cells import cell_of
    from automap.mapping.drive_levels import drive_squares, error_levels
    from automap.mapping.grid import east_north
    from automap.mapping.identity import name_signs, sighting_key
    from automap.mapping.path_errors import Equations
    from automap.mapping.sightings import stack_sightings
    from automap.mapping.tiles import Tile, cut_tiles

    drives = _drives()
    stacked = stack_sightings(drives)
    sign = joined_signs(stacked)
    lat, lon = of.rough_places(stacked, sign)
    members = Members(sign)
    levels = np.sqrt([1.728, 1.152, 0.81])
    tile = Tile(np.arange(3, 9), np.arange(1, 12))
    data = of.tile_data(stacked, members, tile, lat, lon)
    networks = [of.network_of(stacked, data, levels, axes) for axes in (of.HEIGHT, of.PLAN)]
    homes = np.unique(cell_of(lat, lon)).tolist()
    told = [drive_squares(stacked, sign, home) for home in homes]
    common, factors = error_levels(told, len(drives))
    codes = stacked.code
    first = np.unique(sign, return_index=True)[1]
    keys = [sighting_key(drives[stacked.drive[k]], stacked.id[k]) for k in first]
    merged = np.array([0, 2, 1, 2, 0, 1] * 40)[: int(sign.max()) + 1]
    names = [str(n) for n in ("a--back", "b", "other--back", "c")] * 3
    rng = np.random.default_rng(2)
    near = 1e-6 * rng.uniform(0.0, 1.0, (2, 12))
    return levelled(
        {
            "rough": (lat, lon),
            "members": members.of(np.array([2, 0, 7])),
            "own": of.own_variance(stacked, sign),
            "data": data,
            "networks": networks,
            "stray": of.stray_weights(Equations(networks[1])),
            "squares": told,
            "factored": of.adjust(stacked, sign, levels, factors=factors),
            "adjusted": [of.adjust(stacked, sign, each) for each in (levels, None)],
            "levels": common,
            "attributes": combine_attributes(stacked, sign),
            "class": sureness.class_probabilities(codes, stacked.class_probability, sign, merged),
            "group": sureness.group_probabilities(
                codes, stacked.classes, stacked.group_probability, sign, merged
            ),
            "tiles": [table(list(cut_tiles(lat, lon, n, m))) for n, m in ((5, 20.0), (3, 1.0))],
            "names": name_signs(keys, {2: "s7", 4: "s9"}, {"s7", "s9"}),
            "backs": backs(
                names,
                east_north(*near, *near[:, :1]),
                0.05 * np.broadcast_to(np.eye(2), (12, 2, 2)),
                rng.uniform(0.0, 6.0, 12),
            ),
            "with": with_backs(np.arange(6), np.arange(3, 9), np.array([-1, 0, 0, -2, -1, 4])),
        }
    )


@scenario
def mapping_existence() -> Any:
    """Who had what in view, and what it says of being there."""
    from automap.mapping import existence as of
    from automap.mapping import visibility
    from automap.mapping.adjustment import rough_places
    from automap.mapping.by_cells import joined_signs
    from automap.mapping.looks import mean_odds
    from automap.mapping.sightings import stack_sightings

    drives = _drives()
    stacked = stack_sightings(drives)
    sign = joined_signs(stacked)
    lat, lon = rough_places(stacked, sign)
    m = len(lat)
    facing = np.full(m, np.nan)
    facing[sign] = stacked.facing
    views = visibility.opportunities(drives, lat, lon, facing)
    finer = visibility.opportunities(drives, lat, lon, facing, 3)
    rng = np.random.default_rng(6)
    seen = rng.random(len(views)) < 0.5
    pairs = of.chances(sign, stacked.drive, views, facing, stacked.existence)
    plain = of.chances(sign, stacked.drive, views, facing)
    rates = of.detection_rates(pairs, m, 4)
    other = of.DetectionRates(0.7, np.array([0.6, 0.8, 0.3, 0.995]), 0.8, 4.0)
    belief = rng.uniform(0.1, 0.9, m)
    when = 1e9 + np.array([0.0, 3e7, 9e7, 8e7])
    return levelled(
        {
            "views": (views, finer),
            "alike": visibility.alike(views, seen),
            "head on": views.at(visibility.head_on(views, facing)),
            "pairs": (pairs, plain),
            "rates": [rates, of.detection_rates(plain, m, 4), rates.beta, other.beta],
            "weight": other.miss_weight(np.array([0, 1, 2, 3, 3])),
            "ratios": [of._ratios(p) for p in (pairs, plain)],
            "mean": mean_odds(of._ratios(pairs), pairs.sign, m),
            "counts": of._counts(pairs, other, m),
            "mixture": of._mixture(pairs, other, rng.normal(size=m)),
            "spread": of._with_spread(pairs, other, belief),
            "exists": [of.existence(p, r, m, when) for p in (pairs, plain) for r in (rates, other)],
            "still": of.still_there(
                np.array([0, 0, 1, 3]),
                np.array([1.0, 0.4, 0.7, 1.0]),
                other,
                belief[:5],
                np.array([1.0, 2.0, 3.0, 4.0, 5.0]),
            ),
        }
    )


def _values(rng: np.random.Generator, n: int, most: int) -> tuple[Any, FloatArray]:
    """Candidates [n, MOST] of sightings and their columns [n, MOST, 8]."""
    index = np.full((n, most), -1, np.int64)
    values = np.zeros((n, most, 8))
    for i in range(n):
        count = int(rng.integers(0, 4)) if i % 5 else 3
        index[i, :count] = rng.choice(7, count, replace=False)
        values[i, :, :3] = rng.normal(0.0, 1.2, (most, 3)) + np.array([0.6, -0.8, 0.5])
        values[i, :, 3] = rng.uniform(0.3, 1.0, most)
        values[i, :, 5] = rng.uniform(0.3, 1.0, most)
        values[i, :, 4] = rng.uniform(-0.2, 0.2, most)
        values[i, :, 6] = np.where(rng.random(most) < 0.3, np.nan, rng.uniform(0.3, 1.0, most))
        values[i, :, 7] = rng.uniform(3.0, 9.0, most)
    return index, values


@scenario
def mapping_kernels() -> Any:
    """Votes, smoothing and assignment of a drive; cells; histories; ways along roads."""
    from automap.mapping import candidates, grid, offset_kernels
    from automap.mapping.association import assign
    from automap.mapping.attributes import _change_point
    from automap.mapping.limits import MOST

    rng = np.random.default_rng(9)
    n = 9
    index, values = _values(rng, n, MOST)
    time_s = np.cumsum(rng.uniform(1.0, 30.0, n))
    shared = rng.uniform(0.3, 1.2, (n, 3))
    offset, variance = np.zeros((n, 3)), np.zeros((n, 3))
    offset_kernels.vote(time_s, shared, index, values, offset, variance)
    voted = offset.copy(), variance.copy()
    chosen = np.zeros(n, np.int64)
    assign(index, values, offset, rng.uniform(0.0, 0.3, (n, 3)), chosen, np.zeros(7, np.bool_))
    assigned = chosen.copy()
    of_drive = np.array([0.3, -0.2, 0.1]), np.array([0.2, 0.4, 0.3])
    offset_kernels.smooth(time_s, shared, chosen, values, offset, variance)
    lat, lon = -0.6 + 4e-6 * rng.normal(size=12), 2.6 + 4e-6 * rng.normal(size=12)
    lon[:3] = [np.pi - 1e-7, -np.pi + 1e-7, 0.4]
    filled = grid.filled_table(lat, lon, 16.0)
    found = np.full(40, -1, np.int64)
    near = [
        (int(count), np.sort(found[:count]))
        for a, b in zip(lat, lon, strict=True)
        for count in [grid.neighbours(filled, a, b, 1, found)]
    ]
    state = rng.uniform(0.5, 2.0, 13)
    empty = state.copy()
    empty[6] = 0.0
    return levelled(
        {
            "voted": voted,
            "assigned": assigned,
            "smoothed": (offset, variance),
            "agreement": [offset_kernels.agreement(values[i, 0], *of_drive) for i in range(n)],
            "mean": [candidates.mean_of(s) for s in (state, empty)],
            "facing": [
                candidates.facing_evidence(a, v)
                for v in (candidates.facing_variance(np.nan), candidates.facing_variance(0.6))
                for a in (0.1, -0.4, 5.9, 1.2, 3.0, -7.0)
            ],
            "gain": [candidates.match_gain(0.5, 0.2, 0.9, u) for u in (0.3, np.nan)],
            "cells": (filled.cells, *(len(grid.empty_table(n, 16.0).head) for n in (9, 8))),
            "rows": [
                (grid.cells_around(k, 16.0), grid.cell_column(1.3, 977), grid.bucket(k, 3 * k, 63))
                for k in (-9000, -1, 0, 625000)
            ],
            "near": near,
            "apart": grid.delta(lat[0], lon[0], lat[1], lon[1], 6.3e6, 5.1e6),
            "change": [
                _change_point(np.array(codes, np.int64), 3)
                for codes in ([0, 0, 0, 1, 1, 1, 1], [0, 1, 0, 1], [2, 2], [0, 0, 0, 0, 0, 2])
            ],
        }
    )


@scenario
def compare_lists() -> Any:
    """A list of signs against a map, part by part."""
    from automap.inventory import comparison as of
    from automap.inventory import findings, hidden, missing
    from automap.inventory import pairs as pairing
    from automap.inventory.directions import directions_of
    from automap.inventory.displaced import displaced_parts
    from automap.mapping.visibility import opportunities
    from tests.unit.inventory_case import signs_of
    from tests.unit.merge_scene import CLASSES

    drives = _drives(640.0)
    rng = np.random.default_rng(4)
    n = len(drives[1])
    signs = signs_of(drives[1], rng.uniform(0.4, 0.99, n), rng.uniform(0.3, 0.95, n))
    signs = [
        replace(
            s,
            class_probability=0.9 - 0.02 * k if k % 3 else float("nan"),
            existence=s.existence if k % 4 else float("nan"),
            drives=("a", "b", "c")[: 1 + k % 3],
        )
        for k, s in enumerate(signs)
    ]
    m = n + 2
    order = np.concatenate([rng.permutation(n), [0, 1]])
    names = [str(drives[1].class_name[k]) for k in order]
    names[1], names[4], names[6] = "", CLASSES[1], "regulatory--round--white"
    listed = findings.Inventory(
        [f"i{k}" for k in range(m)],
        names,
        drives[1].lat_rad[order] + 2e-7 * rng.normal(size=m) + 1e-7,
        drives[1].lon_rad[order] + 2e-7 * rng.normal(size=m) - 5e-8,
        drives[1].facing_rad[order] + 0.2 * rng.normal(size=m),
        np.where(rng.random(m) < 0.4, np.nan, rng.uniform(0.05, 1.5, m)),
    )
    turned = replace(listed, facing_rad=listed.facing_rad + np.pi)
    partly = [
        replace(turned, facing_rad=turned.facing_rad + np.where(np.arange(m) < k, a, 0.0))
        for k, a in ((m, 0.9), (m // 3, np.pi), (m // 2, 1.5), (m // 4, np.pi), (m, 1.2))
    ]
    shares = [{s.class_name: 0.9 - 0.03 * k, CLASSES[0]: 0.05} for k, s in enumerate(signs)]
    shares[2], shares[5] = {}, {}
    near = pairing.near_pairs(signs, listed)
    pairs = pairing.candidates(signs, listed, shares, near, True)
    rows = findings.looks_at(listed, drives)[1]
    first = pairing.fit(pairs, listed, pairing.doubts(signs), rows > 3)
    alone = pairing.without_common_errors(pairs, first, signs)
    fit = pairing.fit(alone, listed, pairing.doubts(signs), rows > 3)
    chosen = pairing.one_to_one(alone, fit.evidence, n)
    spread = replace(fit, moved=np.linspace(0.0, 1.0, len(pairs.sign)))
    paired = [
        of._paired(alone, k, signs, listed, shares, spread, True) for k in range(len(pairs.sign))
    ]
    other = replace(listed, lat_rad=listed.lat_rad + np.where(np.arange(m) < m // 2, 5e-6, 0.0))
    parts = displaced_parts(signs, other)
    partner = np.full(m, -1)
    partner[pairs.listed[chosen[::2]]] = pairs.sign[chosen[::2]]
    views = opportunities(drives, listed.lat_rad, listed.lon_rad, listed.facing_rad)
    seen_by = [
        frozenset({0, 2}) if k % 3 == 0 else (None if k % 3 else frozenset()) for k in range(m)
    ]
    tries, hits = np.array([3, 1, 0, 4, 2, 2, 5, 1]), np.array([2, 0, 0, 0, 0, 2, 1, 1])
    group = np.array([0, 1, 0, 1, 0, 1, 0, 0])
    looked = np.array([12, 9, 20, 2, 7, 30, 1, 15])
    drives_of = np.array([1, 1, 2, 1, 3, 2, 1, 9])
    gaps = [
        hidden.gaps(part, looked[:k], drives_of[:k])
        for part, k in (
            (np.array([10, 9, 11, 2, 3, 28, 1, 6]), 8),
            (np.array([12, 9]), 2),
            (looked[:0], 0),
        )
    ]
    whole = of.compare_inventory(signs, listed, drives, shares)
    return levelled(
        {
            "pairs": pairs,
            "turned": [directions_of(signs, each, *near) for each in (listed, turned, *partly)],
            "fit": (first, fit),
            "alone": alone,
            "rows": rows,
            "parts": (parts.part, parts.way),
            "chosen": chosen,
            "rivals": pairing.rivals(alone, fit.evidence, chosen, n, m),
            "paired": table(paired),
            "distance": [f.distance_m for f in paired],
            "same": [str(of.same_face(a, b)) for a in names[:7] for b in names[3:7]],
            "sure": table(findings.mark_sure(paired)),
            "lost": [
                (table(part), rate)
                for some in (drives, drives[:2])
                for part, rate in [
                    findings.not_found(
                        listed,
                        partner,
                        signs,
                        some,
                        np.linspace(0.4, 1.0, m),
                        *findings.looks_at(listed, some),
                    )
                ]
            ],
            "belief": [findings.class_belief(s) for s in signs],
            "new": table(findings.new_signs(signs, np.arange(0, n, 4))),
            "judged": table(
                findings.judge_classes([replace(f, kind="class") for f in paired[::2]] + paired)
            ),
            "standing": [
                missing.standing(tries[:k], hits[:k], group[:k], p, some)
                for k, p, some in (
                    (8, (), (0.0,)),
                    (8, ((5.0, 2.0),), (0.01, 0.1)),
                    (3, (), (0.0,)),
                )
            ],
            "counts": missing.counts(views, m, seen_by),
            "gaps": gaps,
            "for good": [hidden.hidden_for_good(g, 4) for g in gaps],
            "gone": [
                float(hidden.gone_by_gaps(g, a, b)[0]) for g in gaps for a, b in ((20, 2), (9, 5))
            ],
            "whole": (table(whole.findings), whole.shift_m, whole.sd_m, whole.detection),
        }
    )
