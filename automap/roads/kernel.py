"""The most probable way along the roads: Viterbi over candidates, with distances by road."""

from __future__ import annotations

import numpy as np

from automap.jit import kernel
from automap.records import FloatArray, IntArray


@kernel
def spread(
    node: int,
    begun: float,
    limit: float,
    first: IntArray,
    to: IntArray,
    length: FloatArray,
    distance: FloatArray,
    touched: IntArray,
    count: int,
) -> int:
    """Shortest distances from a node up to ``limit`` (Dijkstra) into ``distance``, on top of what
    stands there; ``touched`` gets the nodes. Returns how many."""
    if begun >= distance[node]:
        return count
    if distance[node] == np.inf:
        touched[count] = node
        count += 1
    distance[node] = begun
    # the way is short: a list that is looked through is as fast as a heap
    open_nodes = [node]
    while len(open_nodes) > 0:
        best = 0
        for k in range(1, len(open_nodes)):
            if distance[open_nodes[k]] < distance[open_nodes[best]]:
                best = k
        at = open_nodes[best]
        open_nodes[best] = open_nodes[-1]
        open_nodes.pop()
        for edge in range(first[at], first[at + 1]):
            other, way = to[edge], distance[at] + length[edge]
            if way < distance[other] and way <= limit:
                if distance[other] == np.inf:
                    if count == len(touched):
                        return count
                    touched[count] = other
                    count += 1
                distance[other] = way
                open_nodes.append(other)
    return count


@kernel
def viterbi(
    segment: IntArray,
    foot: FloatArray,
    emission: FloatArray,
    straight: FloatArray,
    ends: IntArray,
    size: FloatArray,
    first: IntArray,
    to: IntArray,
    length: FloatArray,
    beta: float,
    jump: float,
) -> tuple[IntArray, FloatArray]:
    """Candidate of each point [n] (-1 without any), and how much longer than the straight line the
    way to it was (NaN where it was not by road).

    ``segment`` [n, k] (-1 none), ``foot`` [n, k] metres from its first end, log ``emission``;
    ``straight`` [n] distance from the point before. ``ends`` [s, 2], ``size`` [s] of segments, the
    graph as rows ``first``, ``to``, ``length``. A way costs its excess over ``beta``, at most
    ``jump``: layers have gaps.
    """
    n, k = segment.shape
    score = np.full((n, k), -np.inf)
    back = np.full((n, k), -1, np.int64)
    excess = np.full((n, k), np.nan)
    distance = np.full(len(first) - 1, np.inf)
    touched = np.empty(len(first) - 1, np.int64)
    before = -1
    gone = 0.0
    for i in range(n):
        gone += straight[i]
        if segment[i, 0] < 0:
            continue
        if before < 0:
            for b in range(k):
                if segment[i, b] >= 0:
                    score[i, b] = emission[i, b]
            before, gone = i, 0.0
            continue
        limit = gone + beta * jump
        for a in range(k):
            own = segment[before, a]
            if own < 0:
                continue
            count = spread(ends[own, 0], foot[before, a], limit, first, to, length, distance,
                           touched, 0)  # fmt: skip
            count = spread(ends[own, 1], size[own] - foot[before, a], limit, first, to, length,
                           distance, touched, count)  # fmt: skip
            for b in range(k):
                other = segment[i, b]
                if other < 0:
                    continue
                way = min(
                    distance[ends[other, 0]] + foot[i, b],
                    distance[ends[other, 1]] + size[other] - foot[i, b],
                )
                if other == own:
                    way = abs(foot[i, b] - foot[before, a])
                cost = min(abs(way - gone) / beta, jump)
                total = score[before, a] - cost + emission[i, b]
                if total > score[i, b]:
                    score[i, b] = total
                    back[i, b] = a
                    excess[i, b] = abs(way - gone) if cost < jump else np.nan
            for place in range(count):
                distance[touched[place]] = np.inf
        before, gone = i, 0.0
    chosen = np.full(n, -1, np.int64)
    longer = np.full(n, np.nan)
    at = -1
    for i in range(n - 1, -1, -1):
        if segment[i, 0] < 0:
            continue
        if at < 0:
            at = int(np.argmax(score[i]))
        chosen[i] = at
        longer[i] = excess[i, at]
        at = back[i, at]
    return chosen, longer
