"""Which stretches of positions lie astray where a receiver contradicts its own velocities, beside
an IMU: how far the path may be off there, and how surely positions are right elsewhere.

Positions part from velocities where a reflection comes or goes. Between two such jumps they are on
the path, or the path passes them by. What it passes by is no witness. Nor is it quite certain that
a place which the path goes along with is right: the way that the readings tell from the positions
before to those behind the stretches astray tells how probable that is, beside how long right
places and others last in this drive (a Markov chain of places that are right or not: Rabiner,
Proceedings of the IEEE 77, 1989, sections III and V).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.fusion.doubts import limits
from automap.fusion.doubts.bridged import Bridge, in_any
from automap.fusion.doubts.path import Misses
from automap.fusion.doubts.position_jump import Places
from automap.fusion.doubts.reason import Reason, Span
from automap.fusion.limits import LEAST_JUDGED
from automap.gates import OUTSIDE_95, gate, sigmas
from automap.records import FloatArray
from automap.sync.limits import STEP_SD_M
from automap.sync.velocity_findings import Interval

CODES = "positions_parted", "positions_aside"


@dataclass(frozen=True)
class Astray:
    """Stretches ``gone`` of positions that are no witness and those ``kept`` between them, GPS s;
    which of the latter follow one another over which of the former: the stretch ``gone[link[i]]``
    lies before ``kept[i + 1]``. ``alone``: the jump of each of the former, None of several.
    ``passed`` [m, 2]: how long the places that the path passes by last, s, and how far they lie off
    it, m."""

    gone: list[Span]
    kept: list[Span]
    link: list[int]
    alone: list[Span | None]
    passed: FloatArray


def beside_imu(
    reasons: Sequence[Reason],
    parted: Sequence[Interval],
    seen: Places,
    high: Places,
    misses: Misses,
    ends: Span,
    age_s: float,
    sd_m: float,
) -> list[Reason]:
    """The ``reasons``, of which those of ``CODES`` say how far the path is off in each stretch.

    ``parted``: where positions and velocities part; ``seen`` positions and ``high`` heights beside
    the readings, ``misses`` of fixes ``age_s`` old off the path, which lasts from one of the
    ``ends`` to the other and is good to ``sd_m`` m an axis. Where positions are on the path for
    half of it or less, or the readings show nothing, all is as it was told. The reason is none to
    doubt the path where that is no more than its sigma.
    """
    if not parted or min(len(seen.t), len(misses)) < LEAST_JUDGED:
        return list(reasons)
    zero = ends[0] + age_s
    found = _astray(parted, misses, zero, ends)
    kept_s = sum(b - a for a, b in found.kept)
    if kept_s <= 0.5 * (ends[1] - ends[0]):
        return list(reasons)
    sound = np.flatnonzero(~in_any(seen.t, found.gone))
    bridge = Bridge(seen, sound, misses, zero)
    above = Bridge(high, np.flatnonzero(~in_any(high.t, found.gone)), misses, zero)
    most_m = max(jump.metres for jump in parted)
    most_m = max(most_m, float(found.passed[:, 1].max(initial=0.0)))
    spans = [(jump.start_gps_s, jump.end_gps_s) for jump in parted]
    beside = replace(bridge, sound=np.flatnonzero(~in_any(seen.t, spans)), apart={})
    shifts = [_shift(bridge, beside, found.gone[i], found.alone[i]) for i in found.link]
    found = _to_the_jumps(found, [jump for _, _, jump in shifts])
    level = _unsure(found, [(metres, sd) for metres, sd, _ in shifts], most_m)
    # a path that follows a jump between two fixes may be off by it there
    jumped = {jump: metres for metres, _, jump in shifts if jump is not None}
    off = [bridge.off(span) or jumped.get(span, 0.0) for span in found.gone]
    if not any(math.isfinite(metres) for metres in off):
        return list(reasons)
    off = [min(metres, most_m) for metres in off]
    highest = [min(above.off(span), _highest(misses, zero, span)) for span in found.gone]
    start = ends[0]
    told = {
        CODES[0]: _told(reasons, CODES[0], found.gone, off, highest, start, sd_m),
        CODES[1]: _told(reasons, CODES[1], found.kept, level, [], start, sd_m),
    }
    return [new for reason in reasons for new in told.get(reason.code, [reason])]


def _told(
    reasons: Sequence[Reason],
    code: str,
    spans: list[Span],
    off_m: Sequence[float],
    high_m: Sequence[float],
    start: float,
    sd_m: float,
) -> list[Reason]:
    """The reason of a ``code`` with how far the path may be off in each of the ``spans``."""
    worst = max(off_m, default=0.0)
    here = tuple((a - start, b - start) for a, b in spans)
    said = (
        f"; by the way that the IMU shows the path is off there by no more than {worst:.1f} m"
        if code == CODES[0]
        else f"; where the path goes along with them it is no further off than {worst:.1f} m"
    )
    sure = worst < math.sqrt(2.0) * sd_m
    return [
        replace(
            reason,
            text=reason.text + said,
            error_m=worst,
            spans=here,
            span_errors_m=tuple(off_m),
            span_heights_m=tuple(high_m),
            led=code == CODES[0],
            state="good" if sure else reason.state,
        )
        for reason in reasons
        if reason.code == code
    ]


def _astray(parted: Sequence[Interval], misses: Misses, zero: float, ends: Span) -> Astray:
    """Stretches without and with positions to believe, by what is ``parted`` and by ``misses``."""
    tag, off = misses.t + zero, np.hypot(*misses.miss[:, :2].T)
    # sound positions step by less, and scatter by what they do here (radius of 95 % by the median)
    usual = float(np.median(off)) * math.sqrt(gate(OUTSIDE_95, 2) / (2.0 * math.log(2.0)))
    near = math.hypot(STEP_SD_M * math.sqrt(gate(OUTSIDE_95, 2)), usual)
    aside = off > near
    jumps = sorted(parted, key=lambda jump: jump.start_gps_s)
    low = np.searchsorted(tag, [*(jump.start_gps_s for jump in jumps), np.inf], side="right")
    high = np.searchsorted(tag, [-np.inf, *(jump.end_gps_s for jump in jumps)])
    places = [slice(int(a), max(int(a), int(b))) for a, b in zip(high, low, strict=True)]
    by_place = [float(np.median(off[rows])) if off[rows].size else math.inf for rows in places]
    runs: list[list[int]] = []
    alone: list[Span | None] = []
    for k in range(len(jumps)):
        before, behind = places[k], places[k + 1]
        first, last = before.stop, behind.start
        # what a jump found late began with, and ended with, is off the path as well
        while first > before.start and (by_place[k] > near or aside[first - 1]):
            first -= 1
        while last < behind.stop and (by_place[k + 1] > near or aside[last]):
            last += 1
        if runs and first <= runs[-1][1]:
            runs[-1][1] = max(last, runs[-1][1])
            alone[-1] = None
        else:
            runs.append([first, last])
            alone.append((jumps[k].start_gps_s, jumps[k].end_gps_s))
    runs, alone = _joined(runs, alone, tag)
    gone = [
        (float(tag[a - 1]) if a else ends[0], float(tag[b]) if b < len(tag) else ends[1])
        for a, b in runs
    ]
    edges = [0, *(row for run in runs for row in run), len(tag)]
    kept: list[Span] = []
    link: list[int] = []
    for k, (a, b) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
        if b > a:
            link += [k - 1] if kept else []
            kept.append((float(tag[a]), float(tag[b - 1])))
    passed = [
        (float(np.ptp(tag[rows])), metres)
        for rows, metres in zip(places, by_place, strict=True)
        if near < metres < math.inf
    ]
    return Astray(gone, kept, link, alone, np.array(passed).reshape(-1, 2))


def _joined(
    runs: list[list[int]], alone: list[Span | None], tag: FloatArray
) -> tuple[list[list[int]], list[Span | None]]:
    """The ``runs`` of rows, each with its jump if it has one ``alone``, of which those are one that
    have too few fixes, or too short a time, between them to tell anything."""
    out: list[list[int]] = [[0, 0]]
    jumps: list[Span | None] = [None]
    for (a, b), jump in zip([*runs, [len(tag), len(tag)]], [*alone, None], strict=True):
        last = out[-1][1]
        short = a - last < limits.STEP_FIXES or tag[a - 1] - tag[last] < limits.STEP_WINDOW_S
        if short:
            out[-1][1], jumps[-1] = b, None if last else jump
        else:
            out.append([a, b])
            jumps.append(jump)
    keep = [k for k, (a, b) in enumerate(out) if b > a or 0 < a < len(tag)]
    return [out[k] for k in keep], [jumps[k] for k in keep]


def _shift(
    bridge: Bridge, beside: Bridge, span: Span, jump: Span | None
) -> tuple[float, float, Span | None]:
    """By how much, m, and how surely, positions go on elsewhere behind a stretch ``span``, and the
    jump where that is seen.

    A path that follows a ``jump`` leaves the positions on both its sides, which are ``beside`` it
    as good a witness as those further off that are on the path, and nearer: but those of a receiver
    that was astray before, and jumps back, go on elsewhere than these."""
    metres, sd = bridge.shift(span)
    if jump is not None:
        near, near_sd = beside.shift(jump)
        if near_sd < sd and abs(near - metres) < sigmas(OUTSIDE_95) * math.hypot(sd, near_sd):
            return near, near_sd, jump
    return metres, sd, None


def _to_the_jumps(found: Astray, jumps: Sequence[Span | None]) -> Astray:
    """The stretches with those that a path follows a jump between, ``jumps`` [n - 1], up to it."""
    gone, kept = list(found.gone), list(found.kept)
    for k, (at, jump) in enumerate(zip(found.link, jumps, strict=True)):
        if jump is not None:
            gone[at] = jump
            kept[k], kept[k + 1] = (kept[k][0], jump[0]), (jump[1], kept[k + 1][1])
    return replace(found, gone=gone, kept=kept)


def _unsure(found: Astray, shifts: list[tuple[float, float]], most_m: float) -> list[float]:
    """How far, m rms, the path may be off in each stretch that it goes along with; ``shifts``
    between them with the sigma of an axis, ``most_m`` how far positions jump.

    Right stretches and others begin by chance and last as these do here (exponential times, a
    stretch of the mean length more of each than were seen); of two sides of a jump each is right as
    probably as it lasted.
    """
    lasted = np.array([b - a for a, b in found.kept])
    usual = max(float(np.mean([*lasted, *found.passed[:, 0]])), 1e-9)
    others, kept = len(found.passed) + 1, len(lasted) + 1
    mean = (found.passed[:, 0].sum() + usual) / others, (lasted.sum() + usual) / kept
    # logarithms of odds that a stretch is none of the right ones
    odds = math.log(others / kept) + np.log(usual / np.maximum(lasted, 1e-9))
    odds -= lasted * max(1.0 / mean[0] - 1.0 / mean[1], 0.0)
    # of an axis
    size = 0.5 * float(np.mean(found.passed[:, 1] ** 2)) if others > 1 else 0.5 * most_m**2
    wrong = _chain(odds, shifts, size)
    off = np.full(len(lasted), 2.0 * size)
    for k, (metres, sd) in enumerate(shifts):
        if math.isfinite(sd):
            part = size / (size + sd**2)
            square = (part * metres) ** 2 + 2.0 * part * sd**2
            off[k : k + 2] = np.minimum(off[k : k + 2], square)
    return [float(metres) for metres in np.sqrt(wrong * off)]


def _chain(odds: FloatArray, shifts: list[tuple[float, float]], size: float) -> FloatArray:
    """How probably each of ``n`` stretches is a wrong one, of which each coordinate is off by
    ``size`` m^2: before anything is seen with the logarithms of ``odds`` [n]; ``shifts`` [n - 1]
    with their sigmas from one to the next."""
    prior = np.stack([np.zeros(len(odds)), odds], axis=1)
    states = np.add.outer([0.0, 1.0], [0.0, 1.0])
    pairs = []
    for metres, sd in shifts:
        variance = sd**2 + size * states
        told = -np.log(variance) - metres**2 / (2.0 * variance)
        pairs.append(told if math.isfinite(sd) else np.zeros((2, 2)))
    ahead = [prior[0]]
    for pair, own in zip(pairs, prior[1:], strict=True):
        ahead.append(own + np.logaddexp.reduce(ahead[-1][:, None] + pair, axis=0))
    back = [np.zeros(2)]
    for pair, own in zip(pairs[::-1], prior[:0:-1], strict=True):
        back.append(np.logaddexp.reduce(pair + own + back[-1], axis=1))
    both = np.array(ahead) + np.array(back[::-1])
    return np.asarray(np.exp(both[:, 1] - np.logaddexp.reduce(both, axis=1)))


def _highest(misses: Misses, zero: float, span: Span) -> float:
    """How far, m, heights lie off the path at most in a ``span``."""
    inside = in_any(misses.t + zero, [span]) & np.isfinite(misses.miss[:, 2])
    return float(np.abs(misses.miss[inside, 2]).max(initial=0.0))
