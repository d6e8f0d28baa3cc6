"""The host clock against GPS time, from the times at which receiver epochs arrived."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from automap.errors import InputError
from automap.gates import sigmas
from automap.records import NO_TIME, BoolArray, ClockModel, FloatArray, IntArray
from automap.sync import limits
from automap.sync.envelope import Envelope, lower_envelope
from automap.sync.steps import ClockStep, find_step
from automap.timebase import gps_to_iso


@dataclass(frozen=True)
class ClockFit:
    """A clock model with what it was found from.

    ``delay_s`` [n] is the arrival of each epoch in the model's GPS time less the epoch,
    NaN for an epoch without arrival time; ``used`` [n] marks the epochs that the fit
    considered. ``waiting_s`` is the median delay beyond the least, ``shape`` the exponent
    of the waiting times at their lower edge, ``wander_s`` how far the clock departs from a
    straight line, ``early`` the number of epochs that arrived before the least delay.
    """

    clock: ClockModel
    delay_s: FloatArray
    used: BoolArray
    waiting_s: float
    shape: float
    wander_s: float
    early: int
    warnings: list[str] = field(default_factory=list)


def fit_arrival_clock(
    arrival_ns: IntArray,
    gps_s: FloatArray,
    output_delay_s: float | None = None,
    drift_sd: float = limits.DRIFT_SD,
) -> ClockFit:
    """Host clock to GPS time from epochs ``gps_s`` [n] and their arrivals ``arrival_ns`` [n].

    An epoch arrives its least delay (``output_delay_s``; with None zero is taken and the
    model's ``output_delay_s`` stays None, for a later estimate) and some waiting after its
    time. The lower edge of the delays gives offset and drift, see ``automap.sync.envelope``.
    ``sd_offset_s`` is the uncertainty of that edge; it says nothing about the least delay
    itself. ``drift_sd`` is the rate error expected of the clock, s/s.

    Raises InputError when no epoch has an arrival time, when the clock stepped or wandered by
    more than a second, or when its rate is off by more than 1000 ppm.
    """
    arrival_ns = np.asarray(arrival_ns, np.int64)
    gps_s = np.asarray(gps_s, np.float64)
    known = (arrival_ns != NO_TIME) & np.isfinite(gps_s)
    if not known.any():
        raise InputError(
            "no receiver epoch has an arrival time, so the host clock cannot be tied to GPS "
            "time; check that the offsets of gnss_arrival.csv belong to this log."
        )
    rows = np.flatnonzero(known)
    ref_ns = int(np.median(arrival_ns[rows]).astype(np.int64))
    ref_gps = float(np.median(gps_s[rows]))
    x: FloatArray = np.asarray((arrival_ns[rows] - ref_ns) * 1e-9, np.float64)
    y: FloatArray = x - (gps_s[rows] - ref_gps)

    warnings: list[str] = []
    consistent = np.ones(len(rows), np.bool_)
    step = find_step(x, y)
    if step is not None:
        consistent = _keep_longer_part(step, x, gps_s[rows], warnings)
    if consistent.sum() < limits.FEW:
        envelope = _few_points(x[consistent], y[consistent], drift_sd)
        warnings.append(
            f"only {int(consistent.sum())} receiver epochs have an arrival time; the clock is "
            f"good to {envelope.covariance[0, 0] ** 0.5 * 1e3:.0f} ms at best"
        )
    else:
        envelope = lower_envelope(
            x[consistent], y[consistent], drift_sd, _resolution(arrival_ns[rows])
        )
    _check_rate(envelope, x)

    above = y - envelope.at(x)
    wander = _wander(x[consistent], above[consistent], envelope)
    if wander > limits.WANDER_ERROR_S:
        raise InputError(
            f"the arrival times depart from a straight line by {wander:.1f} s against GPS time: "
            "check that they belong to this log, that the log is one recording, and that the "
            "host's clock was not set during the drive."
        )
    if wander > limits.WANDER_TOLD_S:
        warnings.append(
            f"the host clock departs from a straight line by {wander * 1e3:.0f} ms against GPS "
            "time; one offset and one drift are fitted to the whole drive"
        )
    sd_offset, sd_drift = np.sqrt(np.diag(envelope.covariance))
    edge = sigmas(limits.EARLY_PROBABILITY) * float(sd_offset)
    early = int(np.sum(above[consistent] < -max(limits.EARLY_S, edge)))
    if early:
        warnings.append(
            f"{early} of {len(rows)} receiver epochs arrived before they can have been sent; "
            "taken as wrong tags and left out of the clock"
        )
    waiting = float(np.median(above[consistent]))
    if waiting > limits.LONG_WAIT_S:
        warnings.append(
            f"half of the receiver epochs arrived {waiting:.1f} s or more later than they could "
            "have; the clock rests on the others: look for a host clock that was set, or a buffer"
        )
    unseen = limits.UNSEEN * max(waiting, 0.0)
    least = output_delay_s or 0.0
    # at host time x_ref an epoch of the least delay has just arrived
    edge_ns = ref_ns + round(envelope.x_ref * 1e9)
    edge_gps = ref_gps + envelope.x_ref - envelope.intercept + least
    clock = ClockModel(
        ref_ns=edge_ns,
        ref_gps_s=edge_gps,
        drift=-envelope.slope,
        sd_offset_s=float(np.sqrt(sd_offset**2 + (0.5 * wander) ** 2 + unseen**2)),
        sd_drift=float(sd_drift),
        method="arrival",
        output_delay_s=output_delay_s,
    )
    delay = np.full(len(gps_s), np.nan)
    delay[rows] = above + least
    used = np.zeros(len(gps_s), np.bool_)
    used[rows] = consistent
    return ClockFit(
        clock=clock,
        delay_s=delay,
        used=used,
        waiting_s=waiting,
        shape=envelope.shape,
        wander_s=wander,
        early=early,
        warnings=warnings,
    )


def _keep_longer_part(
    step: ClockStep, x: FloatArray, gps_s: FloatArray, warnings: list[str]
) -> BoolArray:
    """Epochs on the longer side of a step; InputError when the shorter is worth having too."""
    before = x < step.x
    share = float(min(before.mean(), 1.0 - before.mean()))
    at = gps_to_iso(float(np.median(gps_s[np.argsort(np.abs(x - step.x))[:3]])))
    seen = f"arrival times jump by {step.size:+.3f} s against GPS time near {at}"
    keep = before if before.mean() >= 0.5 else ~before
    # waiting only ever adds: a short raised part may be a busy host, a step back may not
    shorter_is_raised = (step.size > 0.0) == bool(before.mean() >= 0.5)
    allowed = limits.RAISED_SHARE if shorter_is_raised else limits.STEP_SHARE
    if abs(step.size) >= limits.STEP_ERROR_S and share > allowed:
        raise InputError(
            f"{seen}: the host clock was set during the drive, the receiver's time was wrong in "
            "one part, or the arrival times are of another log. Put the files of one recording "
            "together, cut it there into two drives, or record with a monotonic clock."
        )
    warnings.append(
        f"{seen}; the shorter part, {share:.0%} of the epochs, is left out of the clock"
    )
    return keep


def _few_points(x: FloatArray, y: FloatArray, drift_sd: float) -> Envelope:
    """Too few epochs for a shape: the earliest one, with an ordinary waiting as its error."""
    first = int(np.argmin(y))
    sd = max(limits.FEW_SD_S / len(x), float(np.ptp(y)) / len(x))
    return Envelope(
        x_ref=float(x[first]),
        intercept=float(y[first]),
        slope=0.0,
        covariance=np.diag([sd**2, drift_sd**2]),
        shape=1.0,
        width=sd,
        points=len(x),
    )


def _resolution(arrival_ns: IntArray) -> float:
    """The step in which the host wrote its stamps, s; 0 when finer than 10 microseconds."""
    step = int(np.gcd.reduce(np.abs(np.diff(arrival_ns)))) if len(arrival_ns) > 1 else 0
    return step * 1e-9 if 10_000 <= step <= 50_000_000 else 0.0


def _check_rate(envelope: Envelope, x: FloatArray) -> None:
    sd = float(np.sqrt(envelope.covariance[1, 1]))
    if abs(envelope.slope) - sigmas(limits.RATE_PROBABILITY) * sd > limits.MAX_RATE:
        raise InputError(
            f"the host clock runs {envelope.slope * 1e6:+.0f} ppm against GPS time over "
            f"{np.ptp(x):.0f} s, which no clock does: check the unit of t_ns in the arrival file "
            "and that its offsets belong to this log."
        )


def _wander(x: FloatArray, above: FloatArray, envelope: Envelope) -> float:
    """Departure of the lower edge from the line, s, beyond what waiting alone explains.

    In each of up to eight parts the earliest epoch should touch the line to within the
    spacing of the epochs near the edge.
    """
    parts = int(np.clip(len(x) // limits.PART_EPOCHS, 1, limits.WANDER_PARTS))
    if parts < limits.LEAST_WANDER_PARTS:
        return 0.0
    order = np.argsort(x, kind="stable")
    lowest = limits.LOWEST_QUANTILE
    gaps = np.array([np.quantile(above[part], lowest) for part in np.array_split(order, parts)])
    exponent = -1.0 / max(envelope.shape, 1.0)
    spacing = envelope.width * float((envelope.points / parts) ** exponent)
    seen = float(np.quantile(np.abs(gaps), limits.WANDER_QUANTILE))
    return max(0.0, seen - limits.WANDER_SPACINGS * spacing)
