"""The arrays that kernels take, grouped. Named tuples compile; dataclasses do not."""

from __future__ import annotations

from typing import NamedTuple

from automap.effects.term_sums import Terms
from automap.records import FloatArray, IntArray


class Samples(NamedTuple):
    """Samples: ``t`` [n] s, ``raw`` [n, 6] rates and forces, ``extra`` [n, e] extra basis
    signals, ``calm`` [n, 6] what rates and forces without the noise of single readings are more
    than these, ``shocks`` [n, 2] PSD that shocks add to the noise of force and rate."""

    t: FloatArray
    raw: FloatArray
    extra: FloatArray
    calm: FloatArray
    shocks: FloatArray


class ModelArrays(NamedTuple):
    """``terms`` [m, 4] sensor, axis, basis, parameter; ``on_...`` the terms on a measurement;
    ``tau`` [n] correlation times s (0: none); ``walk`` [n] random-walk PSD, or variance of a
    correlated state; ``kept`` [n] which of a node's shares outlasts a change of its size, -1 all of
    it;
    ``noise`` [2] PSD of force and rate; ``longest_step`` s that is no gap; ``gate`` [5] NIS
    thresholds for 1..3 rows, largest inflation, inflation that counts as refused; ``earth_on``."""

    terms: IntArray
    on_position: Terms
    on_velocity: Terms
    on_vehicle: Terms
    tau: FloatArray
    walk: FloatArray
    kept: IntArray
    noise: FloatArray
    longest_step: float
    gate: FloatArray
    earth_on: bool


class NodeArrays(NamedTuple):
    """``t`` [k] s within the samples, ``flags`` [k], ``fix`` [k, 8] latitude, longitude,
    height, velocity NED, wheel speed, speed downwards on springs, ``var`` [k, 15] variances by
    channel, ``signals`` [k, e] that terms are multiplied with; ``keep`` [k, 6] the share of a
    normalised error that outlasts a change of its size."""

    t: FloatArray
    flags: IntArray
    fix: FloatArray
    var: FloatArray
    signals: FloatArray
    keep: FloatArray


class Legs(NamedTuple):
    """From node to node, whatever the levels of noise; a row for each node [k], or one that is
    written over.

    ``trans`` [k, 9, n] transition rows, ``off`` [k, 9] the state that is reached less the one
    linearised about; ``rate`` [k, 3] mean rate, ``now`` [k, 6] rate without the noise of its
    reading and force at the node, ``mid`` [k, 6 + e] the last reading in the middle of a step,
    without its noise, and extra signals, ``place`` [k, 9] the terms of the place, ``at`` [k] the
    sample at the node or before it, ``steps`` [k] running total of the steps of integration; of
    each of these ``dvn`` [m, 3] m/s what forces change the velocity by, ``dt`` [m] s, and the
    sample before it, ``since`` [m].
    """

    trans: FloatArray
    off: FloatArray
    rate: FloatArray
    now: FloatArray
    mid: FloatArray
    place: FloatArray
    at: IntArray
    steps: IntArray
    dvn: FloatArray
    dt: FloatArray
    since: IntArray


class ForwardStore(NamedTuple):
    """What the forward pass leaves, preallocated; empty arrays where only a score is wanted.

    ``nominal`` [k, 10], ``params`` [k, n - 9] the states linearised about, ``mean`` [k, n] the
    error estimate relative to them after the update, ``trans`` [k, 9, n], ``cov``
    [k, n (n + 1) / 2] packed, ``scalars`` [k] running total of scalars; of each scalar in order
    of processing ``h``, ``gain`` [s, n], ``nu``, ``var`` [s], ``factor`` [s] on its own variance,
    ``info`` [s, 3] node, channel, accepted; ``nis`` [k, 15] block NIS before inflation (NaN where
    not measured).
    """

    nominal: FloatArray
    params: FloatArray
    mean: FloatArray
    trans: FloatArray
    cov: FloatArray
    scalars: IntArray
    h: FloatArray
    gain: FloatArray
    nu: FloatArray
    var: FloatArray
    factor: FloatArray
    info: IntArray
    nis: FloatArray
