"""Ways along roads against SciPy's shortest paths, and the matching against trying every one."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from automap.records import FloatArray, IntArray
from automap.roads.kernel import spread, viterbi

Graph = tuple[IntArray, FloatArray, IntArray, IntArray, FloatArray]


def town(rng: np.random.Generator, nodes: int, segments: int) -> Graph:
    """Segments [s, 2] with their lengths, and both directions of them as rows of a graph."""
    ends = np.array([rng.choice(nodes, 2, replace=False) for _ in range(segments)], np.int64)
    size = rng.uniform(5.0, 60.0, segments)
    both = np.vstack([ends, ends[:, ::-1]])
    order = np.argsort(both[:, 0], kind="stable")
    first = np.searchsorted(both[order, 0], np.arange(nodes + 1)).astype(np.int64)
    return ends, size, first, both[order, 1].copy(), np.concatenate([size, size])[order]


def shortest(graph: Graph) -> FloatArray:
    """Ways between all nodes, inf where there is none."""
    ends, size, first, _, _ = graph
    nodes = len(first) - 1
    whole = np.full((nodes, nodes), np.inf)
    for (a, b), way in zip(ends.tolist(), size.tolist(), strict=True):
        whole[a, b] = whole[b, a] = min(whole[a, b], way)
    return np.asarray(dijkstra(csr_matrix(np.where(np.isfinite(whole), whole, 0.0))))


@pytest.mark.parametrize("seed", range(8))
def test_ways_from_both_ends_are_the_shortest_and_all_that_is_touched_is_told(seed: int) -> None:
    rng = np.random.default_rng(seed)
    graph = town(rng, 30, 36)
    _, _, first, to, length = graph
    nodes = len(first) - 1
    ways = shortest(graph)
    distance, touched = np.full(nodes, np.inf), np.empty(nodes, np.int64)
    for _ in range(10):
        one, two = rng.choice(nodes, 2, replace=False)
        begun, other, limit = (
            rng.uniform(0.0, 30.0),
            rng.uniform(0.0, 30.0),
            rng.uniform(40.0, 150.0),
        )
        count = spread(one, begun, limit, first, to, length, distance, touched, 0)
        count = spread(two, other, limit, first, to, length, distance, touched, count)
        expected = np.minimum(begun + ways[one], other + ways[two])
        # the ends themselves are known whatever the limit
        known = (expected <= limit) | np.isin(np.arange(nodes), (one, two))
        np.testing.assert_allclose(distance[known], expected[known])
        assert np.all(np.isinf(distance[~known]))
        # each once: what is touched is put back before the next way is sought
        assert sorted(touched[:count].tolist()) == np.flatnonzero(known).tolist()
        distance[touched[:count]] = np.inf
        assert np.all(np.isinf(distance))


@pytest.mark.parametrize("seed", range(12))
def test_the_match_is_the_best_of_all(seed: int) -> None:
    """Every choice of candidates by its emissions and the costs of its ways."""
    rng = np.random.default_rng(100 + seed)
    graph = town(rng, 8, 10)
    ends, size, first, to, length = graph
    ways = shortest(graph)
    n, k, beta, jump = 5, 3, 8.0, 4.0
    segment = np.array([rng.choice(len(ends), k, replace=False) for _ in range(n)], np.int64)
    segment[1, 2] = -1
    segment[3] = -1
    foot = rng.uniform(0.0, 1.0, (n, k)) * size[segment]
    emission = -rng.uniform(0.0, 3.0, (n, k))
    straight = rng.uniform(5.0, 40.0, n)
    chosen, longer = viterbi(
        segment, foot, emission, straight, ends, size, first, to, length, beta, jump
    )

    def cost(i: int, a: int, j: int, b: int) -> tuple[float, float]:
        gone = straight[i + 1 : j + 1].sum()
        own, other = segment[i, a], segment[j, b]
        leave = foot[i, a], size[own] - foot[i, a]
        enter = foot[j, b], size[other] - foot[j, b]
        limit = gone + beta * jump
        way = min(
            leave[x] + ways[ends[own, x], ends[other, y]] + enter[y]
            if leave[x] + ways[ends[own, x], ends[other, y]] <= limit
            or ends[own, x] == ends[other, y]
            else np.inf
            for x in (0, 1)
            for y in (0, 1)
        )
        if own == other:
            way = abs(foot[j, b] - foot[i, a])
        return min(abs(way - gone) / beta, jump), abs(way - gone)

    rows = [i for i in range(n) if segment[i, 0] >= 0]
    best, at = -np.inf, ()
    for choice in itertools.product(*(np.flatnonzero(segment[i] >= 0).tolist() for i in rows)):
        total = sum(emission[i, a] for i, a in zip(rows, choice, strict=True))
        for (i, a), (j, b) in itertools.pairwise(zip(rows, choice, strict=True)):
            total -= cost(i, a, j, b)[0]
        if total > best:
            best, at = total, choice
    assert chosen[3] == -1
    assert tuple(chosen[rows].tolist()) == at
    assert np.isnan(longer[rows[0]])
    for (i, a), (j, b) in itertools.pairwise(zip(rows, at, strict=True)):
        price, excess = cost(i, a, j, b)
        if price < jump:
            assert longer[j] == pytest.approx(excess)
        else:
            assert np.isnan(longer[j])
