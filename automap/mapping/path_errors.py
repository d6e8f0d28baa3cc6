"""The position errors of paths, from signs that were passed several times.

A path's error has the sigma that the path states. A part of it wanders within a minute or so (a
Gauss-Markov process), the rest outlasts the drive. Passes of one drive and drives of a fleet alike
tell how their errors differ where they see the same signs. Unknowns are the errors, in sigmas, at
the nodes of a path and that of the whole path, and the places of the signs; a node is tied to the
one before it and to the sign that was seen there, so the equations are sparse (normal equations of
a network: Triggs et al., Bundle adjustment, 2000).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from automap.mapping import limits
from automap.records import FloatArray, IntArray
from automap.sparse_normal import Factor, factorise, least_fill

_SETTLED = 0.1
"""Strays are looked for anew unless no weight changes by more than a tenth."""


def path_nodes(time_s: FloatArray, first: IntArray) -> tuple[FloatArray, IntArray, FloatArray]:
    """Nodes of paths, as ``Network`` has them ``alike`` [k]; ``node`` [n, 3] of each of the times
    [n], the one before it, the one after and the path's own, one each, which come last; and how
    much of the error at each it has [n, 3].

    ``first`` [d + 1] where each path begins, with its earliest time. Nodes are ``NODE_S`` apart,
    and between them what wanders goes straight.
    """
    paths = len(first) - 1
    path = np.repeat(np.arange(paths), np.diff(first))
    step = time_s / limits.NODE_S
    before = np.floor(step)
    after = step - before
    begin = before[first[:-1]] if paths else before
    width = int(np.max(before - begin[path], initial=0.0)) + 2
    key = path * width + (before - begin[path]).astype(np.int64)
    used, place = np.unique(np.concatenate([key, key + 1]), return_inverse=True)
    both = np.exp(-limits.NODE_S / limits.PATH_CORRELATION_S)
    begins = np.diff(used // width, prepend=-1) > 0
    alike = np.where(begins, 0.0, both ** np.diff(used, prepend=0))
    node = np.column_stack([*place.reshape(2, -1), len(used) + path])
    # with the sigma that is stated there
    most = np.sqrt(1.0 - 2.0 * after * (1.0 - after) * (1.0 - both))
    between = np.column_stack([(1.0 - after) / most, after / most, np.ones(len(after))])
    return np.append(alike, np.zeros(paths)), node, between


@dataclass(frozen=True)
class Network:
    """Sightings [n] of signs in ``a`` axes, each under the errors at ``p`` nodes.

    ``alike`` [k] correlation of a node's error with that of the node before it, 0 where a path
    begins. ``node`` [n, p] and ``sd`` [n, p, a] of the errors there, whose sum a sighting has,
    ``measured`` [n, a] m, and the ``information`` [n, a, a] of what is a sighting's own, 1/m^2.
    ``sign`` [n] numbers from 0.
    """

    alike: FloatArray
    node: IntArray
    sign: IntArray
    sd: FloatArray
    measured: FloatArray
    information: FloatArray


def network(
    nodes: tuple[FloatArray, IntArray, FloatArray],
    sign: IntArray,
    parts: FloatArray,
    shared_sd: FloatArray,
    measured: FloatArray,
    own: FloatArray,
) -> Network:
    """The network of sightings [n] at the ``nodes`` of ``path_nodes``, with the covariance ``own``
    [n, a, a] of each; ``parts`` [n, 2] of the sd ``shared_sd`` [n, a] of its path that what wanders
    and what lasts have."""
    alike, node, between = nodes
    # what wanders is between two nodes
    sd = (parts[:, :, None] * shared_sd[:, None])[:, [0, 0, 1]] * between[:, :, None]
    return Network(alike, node, sign, sd, measured, np.asarray(np.linalg.inv(own), np.float64))


@dataclass(frozen=True)
class Solution:
    """``place`` [m, a] of the signs in m and ``error`` [k, a] of the paths in sigmas, which is
    ``moved`` [n, a] m at the sightings; ``square`` [n] of their distances from their signs without
    that, in sigmas of their own."""

    place: FloatArray
    error: FloatArray
    moved: FloatArray
    square: FloatArray
    factor: Factor

    def place_variances(self, count: int) -> FloatArray:
        """Covariance [count, a, a] of the first places, m^2."""
        axes = self.place.shape[1]
        at = self.error.size + axes * np.arange(count)[:, None] + np.arange(axes)
        own = self.factor.variances_of(at[:, :, None], np.ones(1))
        result = own[:, :, None] * np.eye(axes)
        for i, j in combinations(range(axes), 2):
            both = self.factor.variances_of(at[:, [i, j]], np.ones(2))
            result[:, i, j] = result[:, j, i] = 0.5 * (both - own[:, [i, j]].sum(axis=1))
        return result


class Equations:
    """The normal equations of a network, whose pattern stays while weights change.

    ``order`` of nodes and signs as of another network of this pattern (None: it is found).
    """

    def __init__(self, network: Network, order: IntArray | None = None) -> None:
        self.network = network
        nodes, axes = len(network.alike), network.measured.shape[1]
        self.nodes, self.signs = nodes, int(network.sign.max()) + 1
        # what a sighting is of: errors, and last its sign
        of = np.column_stack([network.node, nodes + network.sign])
        tied = np.flatnonzero(network.alike > 0.0)
        if order is None:
            a, b = np.triu_indices(of.shape[1], 1)
            a, b = np.append(tied, of[:, a]), np.append(tied - 1, of[:, b])
            order = least_fill(
                np.concatenate([a, b]), np.concatenate([b, a]), nodes + self.signs
            )  # fmt: skip
        self.order = order
        each = np.arange(axes)
        chain = [np.arange(nodes), tied, tied - 1], [np.arange(nodes), tied - 1, tied]
        rows, columns = (
            (axes * np.concatenate(part)[:, None] + each).ravel() for part in chain
        )  # fmt: skip
        self._at = axes * of[:, :, None] + each
        at = self._at.reshape(len(of), -1)
        blocks = np.broadcast_arrays(at[:, :, None], at[:, None, :])
        self._row = np.concatenate([rows, blocks[0].ravel()])
        self._column = np.concatenate([columns, blocks[1].ravel()])
        self._by = np.concatenate([network.sd, np.ones((len(of), 1, axes))], axis=1)
        fresh = 1.0 / (1.0 - network.alike**2)
        own = fresh.copy()
        own[tied - 1] += network.alike[tied] ** 2 * fresh[tied]
        across = -network.alike[tied] * fresh[tied]
        self._prior = np.repeat(np.concatenate([own, across, across]), axes)

    def solve(self, weight: FloatArray | None = None) -> Solution:
        """Places and errors; ``weight`` [n] of the sightings."""
        net = self.network
        axes = net.measured.shape[1]
        W = net.information if weight is None else net.information * weight[:, None, None]
        told = np.einsum("nui,nij,nvj->nuivj", self._by, W, self._by)
        factor = factorise(
            self._row,
            self._column,
            np.concatenate([self._prior, told.ravel()]),
            (axes * self.order[:, None] + np.arange(axes)).ravel(),
        )
        pull = np.einsum("nij,nj->ni", W, net.measured)
        size = axes * (self.nodes + self.signs)
        parts = (self._by * pull[:, None]).ravel()
        right = np.bincount(self._at.ravel(), parts, size).astype(np.float64)
        x = factor.solve(right)
        error, place = np.split(x.reshape(-1, axes), [self.nodes])
        moved = (net.sd * error[net.node]).sum(axis=1)
        miss = net.measured - place[net.sign] - moved
        square = np.einsum("ni,nij,nj->n", miss, net.information, miss)
        return Solution(place, error, moved, square, factor)

    def components(
        self, found: Solution, weight: FloatArray, path: IntArray, own: IntArray, count: int
    ) -> tuple[FloatArray, FloatArray]:
        """Sums of squares [count] of what was found of the errors, in units of what was stated, by
        the group ``path`` [k] of each node and ``own`` [n] of each sighting, and how many such
        squares that is, the expected degrees of freedom [count]: the rest is not told by anything
        (variance components: W. Foerstner, Zeitschrift fuer Vermessungswesen 104, 1979)."""
        net = self.network
        axes = net.measured.shape[1]
        entry = found.factor.inverse_at(self._row, self._column)
        of_node, many = np.repeat(path, axes), len(self._prior)
        at, error = (self._row[:many], self._column[:many]), found.error.ravel()
        squares = np.bincount(of_node[at[0]], self._prior * error[at[0]] * error[at[1]], count)
        squares += np.bincount(own, weight * found.square, count)
        W = net.information * weight[:, None, None]
        told = np.einsum("nui,nij,nvj->nuivj", self._by, W, self._by).reshape(len(own), -1)
        fitted = (told * entry[many:].reshape(told.shape)).sum(axis=1)
        freedom = np.bincount(of_node, minlength=count).astype(np.float64)
        freedom -= np.bincount(of_node[at[0]], self._prior * entry[:many], count)
        freedom += np.bincount(own, axes - fitted, count)
        return np.asarray(squares, np.float64), np.asarray(freedom, np.float64)

    def weights(
        self,
        weigh: Callable[[FloatArray], FloatArray],
        rounds: int,
        square: FloatArray | None = None,
    ) -> FloatArray:
        """Weights [n] of the sightings, by their squared distances, ``square`` [n] where all count
        as stated, if that is known (iteratively reweighted least squares: P. W. Holland, R. E.
        Welsch, Communications in Statistics A 6, 1977)."""
        weight = np.ones(len(self.network.sign))
        for _ in range(rounds):
            square = self.solve(weight).square if square is None else square
            before, weight, square = weight, weigh(square), None
            if np.max(np.abs(before / weight - 1.0), initial=0.0) < _SETTLED:
                break
        return weight
