"""Streets that mislead a map matcher: what was driven is known, point by point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from automap.records import FloatArray, IntArray
from automap.roads.matching import build_network, match_path

Line = Sequence[tuple[float, float]]
LANE_M = 1.75
"""From a road's middle to where one drives on the right."""


@dataclass(frozen=True)
class Leg:
    """A stretch driven along one road: its line from where it is entered to where it is left."""

    road: int
    line: Line


def driven(legs: Sequence[Leg], lane_m: float = LANE_M) -> tuple[FloatArray, IntArray]:
    """Places [n, 2] every two metres in the right lane, and the road of each."""
    places, roads = [], []
    for leg in legs:
        line = np.array(leg.line, np.float64)
        size = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        at = np.arange(0.0, size[-1], 2.0)
        xy = np.column_stack([np.interp(at, size, line[:, k]) for k in range(2)])
        along = np.gradient(xy, axis=0)
        along /= np.linalg.norm(along, axis=1)[:, None]
        places.append(xy + lane_m * np.column_stack([along[:, 1], -along[:, 0]]))
        roads.append(np.full(len(at), leg.road))
    return np.concatenate(places), np.concatenate(roads)


def wander(n: int, sd: float, rng: np.random.Generator, metres: float = 500.0) -> FloatArray:
    """Errors [n, 2] of a fused path: they change over half a kilometre, not from point to point."""
    keep = np.exp(-2.0 / metres)
    error = np.empty((n, 2))
    error[0] = sd * rng.standard_normal(2)
    for k in range(1, n):
        error[k] = keep * error[k - 1] + sd * np.sqrt(1 - keep**2) * rng.standard_normal(2)
    return error


def right(
    lines: Sequence[Line],
    legs: Sequence[Leg],
    error: FloatArray | float = 0.0,
    sd: float = 1.0,
    oneway: Sequence[int] = (),
    lost: slice | None = None,
    lane_m: float = LANE_M,
) -> float:
    """Share of the points more than 15 m from where roads change that are on the right one."""
    places, truth = driven(legs, lane_m)
    yaw = np.arctan2(*np.gradient(places, axis=0).T)
    shown = places + error
    if lost is not None:
        shown[lost] = np.nan
    network = build_network(
        [np.array(line, np.float64) for line in lines],
        np.zeros(len(lines)),
        np.array(oneway, np.int64),
    )
    matched = match_path(shown, yaw, np.full(len(shown), sd), network)
    changes = np.flatnonzero(np.diff(truth))
    clear = np.ones(len(matched.row), bool)
    for at in changes:
        clear &= np.abs(matched.row - at) * 2.0 > 15.0
    told = np.where(matched.segment >= 0, network.road[matched.segment], -1)
    return float(np.mean(told[clear] == truth[matched.row][clear]))


def grid(
    n: int = 5, block: float = 90.0
) -> tuple[list[Line], dict[tuple[int, int, int, int], int]]:
    """Streets of a town, each block a road of its own, and the road between two crossings."""
    lines: list[Line] = []
    number = {}
    for i in range(n):
        for j in range(n):
            for di, dj in ((1, 0), (0, 1)):
                if i + di < n and j + dj < n:
                    a, b = (i * block, j * block), ((i + di) * block, (j + dj) * block)
                    number[i, j, i + di, j + dj] = number[i + di, j + dj, i, j] = len(lines)
                    lines.append([a, b])
    return lines, number


def walk(rng: np.random.Generator, blocks: int = 12, n: int = 5, block: float = 90.0) -> list[Leg]:
    """A way through the town that never turns back at once."""
    _, number = grid(n, block)
    at, before = (int(rng.integers(n)), int(rng.integers(n))), None
    legs = []
    for _ in range(blocks):
        ways = [key[2:] for key in number if key[:2] == at and key[2:] != before]
        to = ways[int(rng.integers(len(ways)))]
        legs.append(
            Leg(
                number[(*at, *to)], [(at[0] * block, at[1] * block), (to[0] * block, to[1] * block)]
            )
        )
        before, at = at, to
    return legs


@pytest.mark.parametrize("sd", [1.0, 3.0, 5.0])
def test_ways_through_a_town_are_found(sd: float) -> None:
    """The property: whatever way is taken, and however the path wanders within its sigma."""
    lines, _ = grid()
    shares = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        legs = walk(rng)
        n = len(driven(legs)[0])
        shares.append(right(lines, legs, wander(n, sd, rng), sd))
    assert np.mean(shares) >= 0.99
    assert np.min(shares) >= 0.95


def test_of_parallel_streets_the_one_that_leads_where_the_path_goes() -> None:
    """Two streets 12 m apart that no side street joins in between; the path wanders by 4 m."""
    lines: list[Line] = [
        [(0, 0), (0, 600)], [(12, 0), (12, 600)], [(0, 600), (-200, 600)], [(12, 600), (200, 600)],
        [(0, 0), (0, -100)], [(12, 0), (200, 0)],
    ]  # fmt: skip
    for seed in range(10):
        rng = np.random.default_rng(seed)
        legs = [Leg(4, [(0, -100), (0, 0)]), Leg(0, [(0, 0), (0, 600)]),
                Leg(2, [(0, 600), (-200, 600)])]  # fmt: skip
        n = len(driven(legs)[0])
        assert right(lines, legs, wander(n, 4.0, rng), 4.0) >= 0.95, seed


def test_the_carriageway_that_is_driven_this_way() -> None:
    """Two carriageways 9 m apart, the path nearer to the other one throughout."""
    lines: list[Line] = [[(0, 0), (0, 800)], [(-9, 800), (-9, 0)]]
    up, down = [Leg(0, [(0, 0), (0, 800)])], [Leg(1, [(-9, 800), (-9, 0)])]
    towards = np.array([-6.0, 0.0])
    assert right(lines, up, towards, 3.0, (1, 1), lane_m=0.0) == 1.0
    assert right(lines, down, -towards, 3.0, (1, 1), lane_m=0.0) == 1.0
    # digitised the other way and said to be driven against it
    assert right([lines[0][::-1], lines[1]], up, towards, 3.0, (-1, 1), lane_m=0.0) == 1.0
    # without being told which way they are driven nothing speaks for the farther one
    assert right(lines, up, towards, 3.0, lane_m=0.0) < 0.5


@pytest.mark.parametrize("blocks", [2, 3, 4])
def test_a_gap_of_the_path_is_bridged(blocks: int) -> None:
    """Some hundred metres without a place, turns in them; what comes after is right."""
    lines, _ = grid()
    shares = []
    for seed in range(20):
        rng = np.random.default_rng(100 + seed)
        legs = walk(rng)
        n = len(driven(legs)[0])
        lost = slice(4 * 45 + 10, 4 * 45 + 10 + blocks * 45)
        shares.append(right(lines, legs, wander(n, 1.5, rng), 1.5, lost=lost))
    assert np.mean(shares) >= 0.99
    assert np.min(shares) >= 0.95


def test_a_ramp_that_leaves_at_a_small_angle() -> None:
    ramp = [(0.0, 300.0), (4.0, 360.0), (14.0, 460.0), (30.0, 560.0), (120.0, 640.0)]
    lines: list[Line] = [[(0, 0), (0, 300)], [(0, 300), (0, 900)], ramp]
    straight = [Leg(0, [(0, 0), (0, 300)]), Leg(1, [(0, 300), (0, 900)])]
    off = [Leg(0, [(0, 0), (0, 300)]), Leg(2, ramp)]
    for seed in range(10):
        rng = np.random.default_rng(seed)
        for legs in (straight, off):
            n = len(driven(legs)[0])
            share = right(lines, legs, wander(n, 2.0, rng), 2.0, (1, 1, 1))
            # along its first 60 m it is no lane's width from the other
            assert share >= 0.9, seed


def test_a_bridge_is_no_crossing() -> None:
    """Roads that cross without a common point: along the one below, and never up to the other."""
    lines: list[Line] = [[(-300, 0), (300, 0)], [(0, -300), (0, 300)]]
    for seed in range(10):
        rng = np.random.default_rng(seed)
        legs = [Leg(0, [(-300, 0), (300, 0)])]
        n = len(driven(legs)[0])
        assert right(lines, legs, wander(n, 3.0, rng), 3.0) == 1.0, seed


def test_a_street_that_ends_within_anothers_line_is_joined_to_it() -> None:
    """Layers of a GIS often have no point where a side street begins."""
    lines: list[Line] = [[(-300, 0), (300, 0)], [(0, 0), (0, 300)], [(8, 20), (8, 300)]]
    legs = [Leg(0, [(-300, 0), (0, 0)]), Leg(1, [(0, 0), (0, 300)])]
    for seed in range(10):
        rng = np.random.default_rng(seed)
        n = len(driven(legs)[0])
        assert right(lines, legs, wander(n, 4.0, rng), 4.0) >= 0.95, seed


def test_a_roundabout_and_a_turn_back() -> None:
    angle = np.linspace(0.0, -2.0 * np.pi, 25)
    ring = [(float(20 * np.cos(a)), float(20 * np.sin(a))) for a in angle]
    arms: list[Line] = [[(20, 0), (300, 0)], [(0, 20), (0, 300)], [(-20, 0), (-300, 0)]]
    lines: list[Line] = [ring[::-1], *arms]
    # in from the west, three quarters round the ring, out to the north
    way = [ring[::-1][k % 24] for k in range(12, 12 + 19)]
    legs = [Leg(3, [(-300, 0), (-20, 0)]), Leg(0, way), Leg(2, [(0, 20), (0, 300)])]
    for seed in range(10):
        rng = np.random.default_rng(seed)
        n = len(driven(legs)[0])
        assert right(lines, legs, wander(n, 1.5, rng), 1.5, (1, 0, 0, 0)) >= 0.93, seed
    back = [Leg(1, [(200, 0), (20, 0)]), Leg(1, [(20, 0), (200, 0)])]
    assert right(lines, back, 0.0, 1.5, (1, 0, 0, 0)) >= 0.95
