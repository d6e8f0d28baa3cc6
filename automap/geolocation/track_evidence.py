"""Whether the boxes of tracks are of this path at all, and of this time of it, by the path itself.

The boxes of one track, the way of the camera and a thing at rest of any size make a linear least
squares problem: with g the place of the thing over its size and w one over its size, a box of
direction (1, y, z) and height h from a camera at c with axes C has
h (C_y - y C_x) (g - w c) = 0, the same for z, and h C_x (g - w c) = 1. So a drive can ask in
little time how well its tracks fit if all frames were of another time, anywhere along the path:
what boxes of elsewhere reach by chance. Right ones are matched by their own time's turns, pitching
and speed, others are matched no better by the time that they claim than by any other.

Two statements about the same boxes are compared by the ratio of their likelihoods, averaged over
what a statement leaves open. If the first is true, that ratio is more than 1 / p with a probability
of p at most, whatever the errors' distribution (Markov's inequality; L. Wasserman, A. Ramdas,
S. Balakrishnan, Universal inference, PNAS 117, 2020). The scale of a track's errors is
unknown: of n residuals over their stated sigmas with a mean square s the likelihood goes with
s^(-n / 2).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from automap.effects.camera import camera_poses, direction_by_turn
from automap.effects.lens import box_variances, focal_length, normalise
from automap.geolocation import limits
from automap.geolocation.rules import GeolocationRules
from automap.geolocation.views import map_origin
from automap.interpolation import poses_at
from automap.records import BoolArray, Camera, Detections, FloatArray, Trajectory

_OWN, _SHARED = 7, 5
"""Unknowns of a track: place over size (3), one over size, attitude of the path while it passes
(3); of all tracks: turn of the camera (3), log focal length, margin of boxes."""
_AT_ONCE, _ROUNDS = 64, 4
"""Offsets that are solved together, and fits with anew weighted tracks."""


_ODDS = -float(np.log(limits.BEYOND_MANIFEST_PROBABILITY))
_LONG_ODDS = -float(np.log(limits.MISFIT_PROBABILITY))


@dataclass(frozen=True)
class Evidence:
    """What speaks against a camera and its stamps, as logarithms of likelihood ratios, which are
    one where nothing tells.

    ``chance`` for tracks that are each of any time of the path; ``late`` for all frames off by up
    to ``limits.LATE_S``, best by ``late_s``; ``paced`` for stamps that run too fast or slow, by as
    much from the first to the last, best by a part ``rate`` of the time from ``begin_s`` at the
    first box on; ``focal`` for another focal length, best ``factor`` of the stated one.
    """

    chance: float = 0.0
    late: float = 0.0
    late_s: float = 0.0
    paced: float = 0.0
    rate: float = 0.0
    begin_s: float = 0.0
    focal: float = 0.0
    factor: float = 1.0

    @property
    def doubts(self) -> bool:
        """Whether a camera and its stamps must be otherwise than they were found."""
        return self.chance > _ODDS or self.is_late or self.is_paced or self.is_zoomed

    @property
    def is_late(self) -> bool:
        """Whether all frames are of another time than was found."""
        return self.late > _LONG_ODDS

    @property
    def is_paced(self) -> bool:
        """Whether stamps run too fast or too slow."""
        return self.paced > _LONG_ODDS

    @property
    def is_zoomed(self) -> bool:
        """Whether the focal length is another one than was found."""
        return self.focal > _LONG_ODDS

    @property
    def shown(self) -> bool:
        """Whether tracks are of their own time of this path rather than of any."""
        return self.chance < -_ODDS

    def allows(self, assumed: bool) -> bool:
        """Whether signs may be placed so: nothing speaks against what was found, or much for what
        was ``assumed``."""
        if assumed:
            return self.shown and not self.is_late and not self.is_paced
        return not self.doubts


NOTHING_TOLD = Evidence()


@dataclass(frozen=True)
class _Tracks:
    """Boxes [n] of tracks [t] that begin at rows ``first`` [t], with stamps ``t_ns`` [n], ``ray``
    [n, 2] right and down over forward, ``height`` [n] over the focal length, sigmas ``sd`` [n, 3]
    of both and of the log height; of each track ``freedom`` [t] its degrees of freedom and
    ``stray`` [t] the probability that it is of no sign."""

    trajectory: Trajectory
    camera: Camera
    origin: tuple[float, float, float]
    t_ns: np.ndarray
    first: np.ndarray
    ray: FloatArray
    height: FloatArray
    sd: FloatArray
    freedom: FloatArray
    stray: FloatArray

    def equations(self, offset_s: FloatArray, rate: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Squares [k, t, 6, 6] of what all tracks have in common and the residual, the tracks' own
        unknowns eliminated, at offsets [k], of their mean time, that grow by a ``rate`` [k] of
        it; and which tracks [k, t] have a path there."""
        K, n = len(offset_s), len(self.t_ns)
        frame, of_box = np.unique(self.t_ns, return_inverse=True)
        late_s = offset_s[:, None] + rate[:, None] * (frame - np.mean(self.t_ns)) * 1e-9
        late = np.round((late_s + self.camera.time_offset_s) * 1e9).astype(np.int64)
        poses = poses_at(self.trajectory, (frame + late).ravel())
        centre, C = camera_poses(poses, self.camera, self.origin)
        known = (poses.covered & np.isfinite(centre).all(axis=1)).reshape(K, -1)[:, of_box]
        centre = np.nan_to_num(centre).reshape(K, -1, 3)[:, of_box]
        C = np.nan_to_num(C).reshape(K, -1, 3, 3)[:, of_box]
        centre -= centre[:, np.repeat(self.first, np.diff(np.append(self.first, n)))]

        # columns: own unknowns, shared ones, what is measured
        D = np.zeros((K, n, 3, _OWN + _SHARED + 1))
        scaled = C * self.height[:, None, None]
        D[:, :, :2, :3] = scaled[:, :, 1:] - self.ray[:, :, None] * scaled[:, :, :1]
        D[:, :, 2, :3] = -scaled[:, :, 0]
        D[:, :, :, 3] = -np.einsum("knri,kni->knr", D[:, :, :, :3], centre)
        by_turn = direction_by_turn(np.column_stack([np.ones(n), self.ray]))
        D[:, :, :, 4:7] = D[:, :, :, 7:10] = by_turn
        D[:, :, :2, 10], D[:, :, 2, 10] = self.ray, 1.0
        D[:, :, 2, 11] = 1.0 / self.height
        D[:, :, 2, 12] = -1.0
        D /= self.sd[:, :, None]
        N = np.add.reduceat(np.swapaxes(D, 2, 3) @ D, self.first, axis=1)
        known_tracks = np.logical_and.reduceat(known, self.first, axis=1)

        usual = 1.0 / limits.USUAL_SIZE_M
        prior = np.array([1e-8] * 3 + [usual**-2] + [limits.PASS_TURN_RAD**-2] * 3)
        N[:, :, range(_OWN), range(_OWN)] += prior
        N[:, :, 3, -1] += prior[3] * usual
        N[:, :, -1, 3] += prior[3] * usual
        N[:, :, -1, -1] += prior[3] * usual**2
        solved = np.linalg.solve(N[:, :, :_OWN, :_OWN], N[:, :, :_OWN, _OWN:])
        rest = N[:, :, _OWN:, _OWN:] - np.swapaxes(N[:, :, :_OWN, _OWN:], 2, 3) @ solved
        return rest, np.asarray(known_tracks)

    def losses(
        self,
        offset_s: FloatArray,
        information: FloatArray,
        rate: FloatArray | None = None,
        least: float = limits.SCATTER_LIMITS[0],
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Negative log likelihood of each track [k, t] at offsets [k] that grow by a ``rate`` [k],
        NaN where it has no path; of what is common [k], by its ``information`` [5] before; and the
        log focal length [k]. Boxes scatter by ``least`` of their sigmas and more."""
        each, common, focal = [], [], []
        rate = np.zeros(len(offset_s)) if rate is None else rate
        for a in range(0, len(offset_s), _AT_ONCE):
            square, known = self.equations(offset_s[a : a + _AT_ONCE], rate[a : a + _AT_ONCE])
            weight = np.ones(known.shape)
            for _ in range(_ROUNDS):
                total = (square * (weight * known)[:, :, None, None]).sum(axis=1)
                total[:, range(_SHARED), range(_SHARED)] += information
                x = np.linalg.solve(total[:, :_SHARED, :_SHARED], total[:, :_SHARED, _SHARED:])
                full = np.concatenate([x[..., 0], -np.ones((len(x), 1))], axis=1)
                chi2 = np.einsum("ki,ktij,kj->kt", full, square, full)
                mean = least**2 + np.maximum(chi2, 0.0) / self.freedom
                weight = 1.0 / mean
            loss = 0.5 * self.freedom / np.mean(limits.COUNT_AS_ONE) * np.log(mean)
            each.append(np.where(known, loss, np.nan))
            common.append(0.5 * np.sum(full[:, :_SHARED] ** 2 * information, axis=1))
            focal.append(full[:, 3])
        return np.concatenate(each), np.concatenate(common), np.concatenate(focal)


def evidence_of(
    trajectory: Trajectory,
    found: Detections,
    camera: Camera,
    rules: GeolocationRules,
) -> Evidence:
    """What speaks against a ``camera``, as it is after all that was found out about it, and the
    stamps of its boxes; those ``out`` [n] say nothing."""
    tracks = _tracks(trajectory, found, camera, rules)
    if tracks is None:
        return NOTHING_TOLD
    information = _information(camera, rules)
    near = limits.LATE_STEP_S * np.arange(
        -round(limits.LATE_S / limits.LATE_STEP_S), round(limits.LATE_S / limits.LATE_STEP_S) + 1.0
    )
    each, common, _ = tracks.losses(near, information)
    own = np.abs(near) <= limits.LATE_OWN_S
    told = np.asarray(np.isfinite(each[own]).all(axis=0))
    if not told.any():
        return NOTHING_TOLD
    each, freedom = each[:, told], tracks.freedom[told]
    total = _total(each, common, freedom)
    here = int(np.nanargmin(np.where(own, total, np.nan)))
    stated = total[here]
    others, _, _ = tracks.losses(_elsewhere(trajectory, tracks), information)
    rate = near / max(np.ptp(tracks.t_ns) * 1e-9, limits.LATE_S / limits.MOST_RATE)
    since = (tracks.t_ns[tracks.first] - np.mean(tracks.t_ns)) * 1e-9
    least = _least_at_middle(each, rate / limits.LATE_STEP_S, since[told])
    middle = near[int(np.argmin(np.where(np.isfinite(total), least, np.inf)))]
    by_rate, common, _ = tracks.losses(np.full(len(rate), middle), information, rate)
    paced = _total(by_rate[:, told], common, freedom)
    fastest = float(rate[int(np.nanargmin(paced))])
    factor, focal = _other_focal(tracks, found, rules, near[here], told, stated)
    return Evidence(
        chance=_by_chance(each[here], np.vstack([each, others[:, told]]), tracks.stray[told]),
        late=_average(stated - total),
        late_s=float(near[int(np.nanargmin(total))]),
        # no less than the average over all offsets of the middle
        paced=_average(stated - paced) - float(np.log(len(near))),
        rate=fastest,
        begin_s=float(middle - fastest * (np.mean(tracks.t_ns) - found.t_ns.min()) * 1e-9),
        focal=focal,
        factor=factor,
    )


def offset_losses(
    trajectory: Trajectory,
    found: Detections,
    camera: Camera,
    rules: GeolocationRules,
    offset_s: FloatArray,
) -> FloatArray:
    """Negative log likelihood [k] of the tracks of a ``camera`` if all its frames are ``offset_s``
    [k] from their stamps, its turn, focal length and margin open, and boxes scatter as measured;
    NaN where nothing is known."""
    tracks = _tracks(trajectory, found, camera, rules)
    if tracks is None:
        return np.full(len(offset_s), np.nan)
    scatter = float(np.sqrt(np.mean(np.square(rules.noise.scales))))
    each, common, _ = tracks.losses(offset_s, _information(camera, rules), least=scatter)
    return _total(each, common, tracks.freedom)


def _information(camera: Camera, rules: GeolocationRules) -> FloatArray:
    """What is known before [5] of what all tracks of a ``camera`` have in common."""
    sd = [limits.DOUBTED_TURN_RAD] * 3 + [max(limits.STATED_FOCAL_SD, camera.focal_sd)]
    return np.array([*sd, rules.camera_margin_sd_px / focal_length(camera)]) ** -2.0


def _least_at_middle(each: FloatArray, rate: FloatArray, since: FloatArray) -> FloatArray:
    """The least loss [k] of all tracks at offsets [k] of their mean time, whatever the ``rate``
    [r] in steps between offsets a second, by the losses ``each`` [k, t] of tracks that are
    ``since`` [t] s from it. What is open in common is as each offset alone leaves it."""
    worst = np.nanmax(each, axis=0)
    losses = np.where(np.isfinite(each), each, worst)
    at = np.arange(len(each))[:, None, None] + np.rint(rate[:, None] * since).astype(np.int64)
    inside = (at >= 0) & (at < len(each))
    found = losses[np.clip(at, 0, len(each) - 1), np.arange(len(since))]
    return np.asarray(np.where(inside, found, worst).sum(axis=2).min(axis=1))


def _by_chance(stated: FloatArray, anywhere: FloatArray, stray: FloatArray) -> float:
    """How much likelier tracks are if each is of any time of the path, by their losses ``stated``
    [t] and ``anywhere`` [k, t]. One that is of no sign, with a probability of ``stray`` [t], is so
    in any case."""
    told = np.isfinite(stated)
    gains = np.array(
        [_average(one - row) for one, row in zip(stated[told], anywhere.T[told], strict=True)]
    )
    of_sign, of_none = np.log1p(-stray[told]), np.log(stray[told])
    return float(-np.sum(np.logaddexp(of_sign - gains, of_none)))


def _average(gain: FloatArray) -> float:
    """Logarithm of the mean of likelihood ratios by their logarithms [k], NaN unknown."""
    known = gain[np.isfinite(gain)]
    most = float(known.max())
    return most + float(np.log(np.mean(np.exp(known - most))))


def _total(each: FloatArray, common: FloatArray, freedom: FloatArray) -> FloatArray:
    """Loss [k] of all tracks; NaN where too many of them have no path."""
    share = np.isfinite(each) @ freedom / freedom.sum()
    enough = share >= limits.COVERED_SHARE
    with np.errstate(divide="ignore", invalid="ignore"):
        total = np.nansum(each, axis=1) / share + common
    return np.where(enough, total, np.nan)


def _elsewhere(trajectory: Trajectory, tracks: _Tracks) -> FloatArray:
    """Offsets that lay the tracks over other times of the path, evenly."""
    first, last = (int(t) for t in (tracks.t_ns.min(), tracks.t_ns.max()))
    start, end = (int(t) for t in trajectory.t_ns[[0, -1]])
    # each track is to meet all of the path, so that they may hang over its ends
    low, high = (start - last) * 1e-9, (end - first) * 1e-9
    step = max((high - low) / limits.PLACES, limits.LATE_STEP_S)
    offsets = np.arange(low, high, step)
    return np.asarray(offsets[np.abs(offsets) > limits.LATE_S])


def _other_focal(
    stated: _Tracks,
    found: Detections,
    rules: GeolocationRules,
    offset_s: float,
    told: BoolArray,
    loss: float,
) -> tuple[float, float]:
    """The focal length, as a part of the stated one, that tracks fit best, and how much likelier
    they are if it is any other; ``told`` [t] which tracks have a path at the offset, with a
    ``loss`` as stated."""
    camera, f = stated.camera, focal_length(stated.camera)
    best, losses = [], []
    for scale in limits.FOCAL_SCALES:
        matrix = camera.matrix.copy()
        matrix[:2, :2] *= scale
        other = replace(camera, matrix=matrix)
        tracks = _tracks(stated.trajectory, found, other, rules, camera)
        # a lens may not reach all of the picture: of fewer boxes the loss is another's
        if tracks is None or len(tracks.t_ns) != len(stated.t_ns):
            continue
        sd = [limits.DOUBTED_TURN_RAD] * 3 + [limits.DOUBTED_FOCAL]
        information = np.array([*sd, rules.camera_margin_sd_px / (f * scale)]) ** -2.0
        each, common, focal = tracks.losses(np.array([offset_s]), information)
        losses.append(_total(each[:, told], common, tracks.freedom[told])[0])
        best.append(scale * float(np.exp(focal[0])))
    if not np.isfinite(losses).any():
        return 1.0, -np.inf
    return best[int(np.nanargmin(losses))], _average(loss - np.array(losses))


def _tracks(
    trajectory: Trajectory,
    found: Detections,
    camera: Camera,
    rules: GeolocationRules,
    stated: Camera | None = None,
) -> _Tracks | None:
    """The tracks that have boxes enough to say something; None without any. Boxes scatter by as
    many pixels as with the ``stated`` camera."""
    stated = stated or camera
    box = np.asarray(found.box, np.float64).reshape(-1, 4)
    ray = normalise(camera, 0.5 * (box[:, :2] + box[:, 2:]))
    height = (box[:, 3] - box[:, 1]) / focal_length(camera)
    track = np.asarray(found.track, np.int64)
    rows = np.flatnonzero(np.isfinite(ray).all(axis=1) & (height > 0.0) & (track >= 0))
    _, number, count = np.unique(track[rows], return_inverse=True, return_counts=True)
    telling = np.flatnonzero(count >= limits.CAMERA_VIEWS)
    if not len(telling):
        return None
    some = np.linspace(0, len(telling) - 1, min(len(telling), limits.MOST_SIGNS_TRIED))
    rows = rows[np.isin(number, telling[some.astype(np.int64)])]
    rows = rows[np.lexsort([found.t_ns[rows], track[rows]])]
    first = np.flatnonzero(np.diff(track[rows], prepend=-1) != 0)
    size = np.diff(np.append(first, len(rows)))
    # of a track of many boxes as many, evenly
    of, share = np.repeat(size, size), np.repeat(np.minimum(size, limits.TRACK_BOXES), size)
    number = np.arange(len(rows)) - np.repeat(first, size)
    rows = rows[(number + 1) * share // of != number * share // of]
    size = np.minimum(size, limits.TRACK_BOXES)
    first = np.cumsum(size) - size
    noise, f = rules.noise, focal_length(stated)
    variance = box_variances(
        *(stated, box[rows], height[rows] * focal_length(camera) / f),
        *(noise.pixel_sd, noise.box_fraction, noise.attitude_sd),
    )
    sd = np.sqrt(variance * limits.COUNT_AS_ONE / np.mean(limits.COUNT_AS_ONE))
    sd[:, :2] *= f / focal_length(camera)
    score = np.add.reduceat(np.asarray(found.score, np.float64)[rows], first) / size
    return _Tracks(
        *(trajectory, camera, map_origin(trajectory), np.asarray(found.t_ns, np.int64)[rows]),
        *(first, ray[rows], height[rows], sd),
        np.maximum(3.0 * size - _OWN, 1.0),
        1.0 - np.clip(score, *limits.BOX_LIMITS),
    )
