"""Columns that are made of others, as thousands of courses of time are of hundreds of boxes.

Each is made of one group's columns only, so that nothing as large as all pairs of what is made is
ever needed: what is asked of their information is worked out from that of what they are made of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from automap.records import FloatArray, IntArray


class Group(NamedTuple):
    """``columns`` [n] that are made of ``rows`` [r] of what is there, ``by`` [r, n]."""

    rows: IntArray
    columns: IntArray
    by: FloatArray


@dataclass(frozen=True)
class Mixing:
    """How ``count`` columns are made of others, group by group."""

    groups: tuple[Group, ...]
    count: int

    @cached_property
    def _place(self) -> tuple[IntArray, IntArray]:
        """Group [v] of each column, and its number [v] within that."""
        group, number = np.zeros((2, self.count), np.int64)
        for g, each in enumerate(self.groups):
            group[each.columns], number[each.columns] = g, np.arange(len(each.columns))
        return group, number

    def of(self, values: FloatArray) -> FloatArray:
        """Values [..., v] of the columns from those [..., c] of what they are made of."""
        out = np.zeros((*values.shape[:-1], self.count))
        for rows, columns, by in self.groups:
            out[..., columns] = values[..., rows] @ by
        return out

    def matrix(self, at: Sequence[int], c: int) -> FloatArray:
        """How some columns are made of all that is there [c, k]."""
        group, number = self._place
        out = np.zeros((c, len(at)))
        for k, i in enumerate(at):
            its = self.groups[group[i]]
            out[its.rows, k] = its.by[:, number[i]]
        return out

    def within(self, info: FloatArray) -> tuple[FloatArray, ...]:
        """Information [n, n] of the columns of each group, of that [c, c] of what is there."""
        return tuple(g.by.T @ info[np.ix_(g.rows, g.rows)] @ g.by for g in self.groups)

    def half(self, info: FloatArray, at: IntArray) -> FloatArray:
        """Information [k, c] between some columns and what is there."""
        group, number = self._place
        out = np.empty((len(at), len(info)))
        for g in np.unique(group[at]):
            mine, its = group[at] == g, self.groups[g]
            out[mine] = (info[:, its.rows] @ its.by[:, number[at[mine]]]).T
        return out

    def outer(self, at: IntArray, weights: FloatArray, c: int) -> FloatArray:
        """The sum [c, c] of the ``weights`` [k] of some columns times what these are made of, each
        with itself."""
        group, number = self._place
        out = np.zeros((c, c))
        for g in np.unique(group[at]):
            mine, its = group[at] == g, self.groups[g]
            by = its.by[:, number[at[mine]]]
            out[np.ix_(its.rows, its.rows)] += by * weights[mine] @ by.T
        return out

    def pairs(self, info: FloatArray, within: Sequence[FloatArray], parts: IntArray) -> FloatArray:
        """Information [k, p, p] of parts [k, p], of which most are of one group."""
        group, number = self._place
        out = np.empty((*parts.shape, parts.shape[1]))
        alone = (group[parts] == group[parts[:, :1]]).all(axis=1)
        for g in np.unique(group[parts[alone, 0]]):
            mine = alone & (group[parts[:, 0]] == g)
            at = number[parts[mine]]
            out[mine] = within[g][at[:, :, None], at[:, None, :]]
        for k in np.flatnonzero(~alone):
            made = self.matrix(parts[k].tolist(), len(info))
            out[k] = made.T @ info @ made
        return out
