"""Which road a path went along, and where on it the signs stand.

A hidden Markov model (P. Newson and J. Krumm, Hidden Markov Map Matching Through Noise and
Sparseness, ACM SIGSPATIAL 2009): a place on a road is the likelier the nearer the path and the more
alike their headings, a way from one place to the next the likelier the less it is longer than the
path. The layer's error and the ways' excess are estimated from the path itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from automap.gates import gate_in_plane, sd_by_median
from automap.records import DrivePath, FloatArray, IntArray, RoadPosition, Roads, Sign
from automap.roads.kernel import viterbi

STEP_M = 8.0
"""Between points of the path that are matched: some car lengths, less than a road between two
junctions."""
LAYER_SD_M, LEAST_LAYER_SD_M, LARGEST_LAYER_SD_M = 5.0, 2.0, 15.0
"""Error of a road's line, the half width of a carriageway within: before the data (chosen: of lines
drawn from aerial pictures), and its limits."""
BETA_M, LEAST_BETA_M, LARGEST_BETA_M = 2.0, 0.5, 10.0
"""Mean excess of a way by road over the path's, before the data (that of Newson and Krumm lies
between, for points 1 to 30 s apart), and its limits."""
JUMP = 12.0
"""Nats that a way costs at most: a gap in the layer is as unlikely as chance beyond five sigmas."""
HEADING_SD = 0.35
"""Of a lane's heading against the road's line, rad: lines have corners where cars take bends."""
AGAINST = 8.0
"""Nats that heading costs at most: cars turn round."""
REACH = math.sqrt(gate_in_plane(math.exp(-8.0)))
"""Sigmas within which a road is a candidate: a right one lies beyond once in 3000."""
MOST = 10
"""Candidates of a point, the nearest: at a junction some six lines meet. Chosen."""
SNAP_M = 0.5
"""Ends of lines so near meet: layers are rounded to decimetres."""
ABOUT_M = 10.0
"""A sign belongs to a road that the path took where it was hardly further from it than at its
nearest: at a junction that may be either."""
FARTHEST_M = 60.0
"""Signs further from the path are on no road of it; that is as far as signs are in view."""


@dataclass(frozen=True)
class Network:
    """Segments [s] of roads in metres: ``begin``, ``end`` [s, 2], ``size``, the ``road`` each is
    of, whether that is driven ``oneway`` (1 along, -1 against, 0 both ways), its ``chainage_m``;
    ``ends`` [s, 2] nodes, and the graph of these by rows ``first``."""

    begin: FloatArray
    end: FloatArray
    size: FloatArray
    road: IntArray
    oneway: IntArray
    chainage_m: FloatArray
    ends: IntArray
    first: IntArray
    to: IntArray
    length: FloatArray


@dataclass(frozen=True)
class MatchedPath:
    """Points [n] of the path in metres ``xy``, their heading ``yaw``, row of the path ``row``,
    and the segment each was matched to (-1 none) with its distance."""

    xy: FloatArray
    yaw: FloatArray
    row: IntArray
    segment: IntArray
    distance_m: FloatArray


def road_positions(
    path: DrivePath, roads: Roads, signs: Sequence[Sign], seen: Sequence[tuple[float, float]]
) -> tuple[list[RoadPosition | None], MatchedPath]:
    """Where each of ``signs`` stands on the roads that the path went along; None for none.

    ``seen`` are the first and last times (GPS seconds) of each sign, NaN unknown.
    """
    from pyproj import Transformer

    lat0, lon0 = np.degrees(np.nanmedian(path.lat_rad)), np.degrees(np.nanmedian(path.lon_rad))
    plane = Transformer.from_crs(
        "OGC:CRS84",
        f"+proj=tmerc +lat_0={lat0} +lon_0={lon0} +k=1 +ellps=WGS84 +units=m",
        always_xy=True,
    )
    network = build_network(
        [np.column_stack(plane.transform(line[:, 0], line[:, 1])) for line in roads.lines],
        roads.start_m,
        roads.oneway,
    )
    xy = np.column_stack(plane.transform(np.degrees(path.lon_rad), np.degrees(path.lat_rad)))
    matched = match_path(xy, path.yaw_rad, np.hypot(path.sd_enu[:, 0], path.sd_enu[:, 1]), network)
    lon = np.degrees([s.lon_rad for s in signs])
    lat = np.degrees([s.lat_rad for s in signs])
    places = np.column_stack(plane.transform(lon, lat)).reshape(-1, 2)
    time = path.gps_s[matched.row]
    result = [
        _on_road(places[k], sign, seen[k], time, matched, network) for k, sign in enumerate(signs)
    ]
    return result, matched


def build_network(
    lines: Sequence[FloatArray], start_m: FloatArray, oneway: IntArray | None = None
) -> Network:
    """Segments and graph of lines [k, 2] in metres; vertices nearer than SNAP_M are one node."""
    begin, end, road, at = [], [], [], []
    for k, line in enumerate(lines):
        size = np.linalg.norm(np.diff(line, axis=0), axis=1)
        good = size > 0.0
        begin.append(line[:-1][good])
        end.append(line[1:][good])
        road.append(np.full(int(good.sum()), k, np.int64))
        at.append(start_m[k] + np.concatenate([[0.0], np.cumsum(size)])[:-1][good])
    first_end, last_end = np.vstack(begin), np.vstack(end)
    points = np.vstack([first_end, last_end])
    near = cKDTree(points).query_pairs(SNAP_M, output_type="ndarray")
    links = coo_array((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(points),) * 2)
    n_nodes, node = connected_components(links, directed=False)
    s = len(first_end)
    ends = np.column_stack([node[:s], node[s:]]).astype(np.int64)
    size = np.linalg.norm(last_end - first_end, axis=1)
    road_of = np.concatenate(road)
    ways = np.zeros(s, np.int64) if oneway is None or not len(oneway) else oneway[road_of]
    source = np.concatenate([ends[:, 0], ends[:, 1]])
    order = np.argsort(source, kind="stable")
    first = np.concatenate([[0], np.cumsum(np.bincount(source, minlength=n_nodes))])
    return Network(
        first_end, last_end, size, road_of, ways, np.concatenate(at), ends,
        first.astype(np.int64), np.concatenate([ends[:, 1], ends[:, 0]])[order],
        np.concatenate([size, size])[order],
    )  # fmt: skip


def match_path(xy: FloatArray, yaw: FloatArray, sd: FloatArray, network: Network) -> MatchedPath:
    """Match a path [n, 2] in metres of heading ``yaw`` and sigma ``sd`` [n] to the network."""
    good = np.flatnonzero(np.isfinite(xy).all(axis=1))
    step = np.linalg.norm(np.diff(xy[good], axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(step)])
    row = good[np.concatenate([[True], np.diff(np.floor(along / STEP_M)) > 0])]
    points = xy[row]
    # the course of the path where the attitude is unknown
    course = np.arctan2(*np.gradient(points, axis=0).T) if len(row) > 1 else np.zeros(len(row))
    heading = np.where(np.isfinite(yaw[row]), yaw[row], course)
    straight = np.concatenate([[0.0], np.linalg.norm(np.diff(points, axis=0), axis=1)])
    own = np.nan_to_num(sd[row], nan=LAYER_SD_M)
    layer, beta = LAYER_SD_M, BETA_M
    for last in (False, True):
        sigma = np.hypot(own, layer)
        segment, foot, distance, told = _candidates(points, heading, sigma, network)
        chosen, longer = viterbi(
            segment, foot, told, straight, network.ends, network.size, network.first,
            network.to, network.length, beta, JUMP,
        )  # fmt: skip
        on = np.flatnonzero(chosen >= 0)
        apart = np.full(len(row), np.nan)
        apart[on] = distance[on, chosen[on]]
        if last or not len(on):
            break
        layer = min(max(sd_by_median(apart[on]), LEAST_LAYER_SD_M), LARGEST_LAYER_SD_M)
        known = longer[np.isfinite(longer)]
        if len(known):
            # the median of an exponential distribution is its mean times log 2
            beta = min(max(float(np.median(known)) / math.log(2), LEAST_BETA_M), LARGEST_BETA_M)
    result = np.full(len(row), -1, np.int64)
    result[on] = segment[on, chosen[on]]
    return MatchedPath(points, heading, row, result, apart)


def _candidates(
    points: FloatArray, heading: FloatArray, sigma: FloatArray, network: Network
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Segments near each point [n, MOST] (-1 none, nearest first), foot points, distances and log
    probabilities."""
    import shapely

    tree = shapely.STRtree(shapely.linestrings(np.stack([network.begin, network.end], axis=1)))
    who, which = tree.query(
        shapely.points(points), predicate="dwithin", distance=np.full(len(points), REACH) * sigma
    )
    foot, distance = _project(points[who], network, which)
    course = np.arctan2(*(network.end - network.begin).T)
    way = network.oneway[which]
    # either way along a road that is driven both ways
    period = np.where(way == 0, np.pi, 2.0 * np.pi)
    turn = heading[who] - course[which] - np.where(way < 0, np.pi, 0.0)
    turn = np.abs((turn + period / 2) % period - period / 2)
    told = -0.5 * (distance / sigma[who]) ** 2
    told = told - np.minimum(0.5 * (turn / HEADING_SD) ** 2, AGAINST)
    order = np.lexsort((distance, who))
    place = np.arange(len(who)) - np.searchsorted(who[order], who[order])
    kept = place < MOST
    rows, columns = who[order][kept], place[kept]
    segment = np.full((len(points), MOST), -1, np.int64)
    shape = segment.shape
    feet, distances, logs = np.zeros(shape), np.full(shape, np.inf), np.full(shape, -np.inf)
    segment[rows, columns] = which[order][kept]
    feet[rows, columns] = foot[order][kept]
    distances[rows, columns] = distance[order][kept]
    logs[rows, columns] = told[order][kept]
    return segment, feet, distances, logs


def _project(
    points: FloatArray, network: Network, segments: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Foot points, metres from the first end, and distances of points [k, 2] on segments [k]."""
    along = (network.end - network.begin)[segments] / network.size[segments, None]
    apart = points - network.begin[segments]
    foot = np.clip(np.einsum("ki,ki->k", apart, along), 0.0, network.size[segments])
    return foot, np.linalg.norm(apart - foot[:, None] * along, axis=1)


def _on_road(
    place: FloatArray,
    sign: Sign,
    seen: tuple[float, float],
    time: FloatArray,
    matched: MatchedPath,
    network: Network,
) -> RoadPosition | None:
    usable = matched.segment >= 0
    if np.isfinite(seen).all():
        # it is passed some seconds after it was seen last
        usable &= (time >= seen[0] - 5.0) & (time <= seen[1] + 10.0)
    if not usable.any() or not np.isfinite(place).all():
        return None
    rows = np.flatnonzero(usable)
    distance = np.linalg.norm(matched.xy[rows] - place, axis=1)
    if distance.min() > FARTHEST_M:
        return None
    near = distance < distance.min() + ABOUT_M
    about = rows[near]
    # a face is read from in front, also where a drive came back on the near side
    front = near & (np.cos(matched.yaw[rows] - sign.facing_rad) < 0.0)
    nearest = int(rows[np.where(front if front.any() else near, distance, np.inf).argmin()])
    segments = np.flatnonzero(np.isin(network.road, network.road[matched.segment[about]]))
    foot, apart = _project(np.broadcast_to(place, (len(segments), 2)), network, segments)
    best = int(np.argmin(apart))
    own, at = int(segments[best]), float(foot[best])
    along = (network.end[own] - network.begin[own]) / network.size[own]
    from_line = place - network.begin[own]
    right = float(from_line[0] * along[1] - from_line[1] * along[0])
    course = math.atan2(along[0], along[1])
    forward_driven = math.cos(matched.yaw[nearest] - course) > 0.0
    # traffic goes against the direction that the face looks
    looks = sign.facing_rad if math.isfinite(sign.facing_rad) else matched.yaw[nearest] + math.pi
    forward = math.cos(looks + math.pi - course) > 0.0
    side = sign.side if sign.side in ("left", "right") else ""
    if side and not forward_driven:
        side = "right" if side == "left" else "left"
    return RoadPosition(
        int(network.road[own]),
        float(network.chainage_m[own] + at),
        math.copysign(float(apart[best]), right),
        side or ("right" if right > 0.0 else "left"),
        "forward" if forward else "backward",
    )
