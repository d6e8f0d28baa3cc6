"""Whether a video turns as the path of its camera does, told without any sign.

In bends the background turns through the picture by what the gyro measured. Stretches in which the
path turns most are followed from picture to picture (``camera_motion``); the offset at which both
turn alike is how far the frames are from their stamps, its growth from bend to bend the pace of the
stamps, and a turn to the other side or on end a picture that is mirrored or turned. Correlation of
turn rates is how cameras and gyros are aligned in time (Kelly and Sukhatme, A General Framework for
Temporal Calibration of Multiple Proprioceptive and Exteroceptive Sensors, 2010).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from automap.frames import matrix_to_rotation_vector, rpy_to_matrix
from automap.gates import exceeds_ratio, gate, sigmas
from automap.records import BoolArray, Camera, FloatArray, IntArray, PictureTurns, VideoFrame
from automap.vision import limits
from automap.vision.camera_motion import ImageMotion
from automap.vision.camera_path import CameraPath

PathOf = Callable[[IntArray], CameraPath | None]
"""The path of a camera at stamps [n]."""

# what a turn (about forward, right, down) looks like in a picture that is not as stated
_PICTURES: tuple[tuple[tuple[str, ...], FloatArray], ...] = (
    ((), np.eye(3)),
    (("mirrored", "upside down"), np.diag([-1.0, 1.0, -1.0])),
    (("mirrored", "upside down"), np.diag([1.0, -1.0, -1.0])),
    (("turned to the left",), np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])),
    (("turned to the right",), np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])),
)


@dataclass(frozen=True)
class Steps:
    """Pairs of frames of one bend: ``old_ns``, ``new_ns`` [k] and the pictures' ``turn`` [k, 3]."""

    old_ns: IntArray
    new_ns: IntArray
    turn: FloatArray


@dataclass(frozen=True)
class _Bend:
    """Where pictures and path of a bend agree best: correlation, offset s and its sigma, at ns.
    ``followed`` [f] the correlation with a path that is followed, as ``FOLLOWED_S`` says;
    ``turns`` numbers that were compared."""

    turns: int
    correlation: float
    followed: FloatArray
    offset_s: float
    sd_s: float
    at_ns: float


def frames_to_follow(path: CameraPath, t_ns: IntArray) -> list[IntArray]:
    """Rows of frames [n], some ten a second, of the stretches in which the path turns most."""
    if len(t_ns) < 2:
        return []
    turn = np.zeros(len(t_ns))
    both = path.known[1:] & path.known[:-1]
    turn[1:][both] = _turns(path.C_cam_ref[:-1][both], path.C_cam_ref[1:][both])[:, 2]
    heading = np.cumsum(turn)
    t_s = (t_ns - t_ns[0]) * 1e-9
    starts = np.arange(0.0, t_s[-1], 0.25 * limits.BEND_S)
    found = []
    for start in starts:
        rows = np.flatnonzero((t_s >= start) & (t_s < start + limits.BEND_S))
        if len(rows) > 1:
            found.append((float(np.ptp(heading[rows])), start, rows))
    chosen: list[tuple[float, IntArray]] = []
    for turned, start, rows in sorted(found, key=lambda one: -one[0]):
        apart = all(abs(start - other) >= limits.BEND_S for other, _ in chosen)
        if turned >= limits.LEAST_BEND_RAD and apart and len(chosen) < limits.MOST_BENDS:
            chosen.append((start, rows))
    return [_thinned(rows, t_s) for _, rows in sorted(chosen, key=lambda one: one[0])]


def _thinned(rows: IntArray, t_s: FloatArray) -> IntArray:
    kept = [int(rows[0])]
    for row in rows[1:].tolist():
        if t_s[row] - t_s[kept[-1]] >= limits.TURN_STEP_S:
            kept.append(row)
    return np.array(kept, np.int64)


def picture_turns(
    camera: Camera,
    path_of: PathOf,
    t_ns: IntArray,
    frame: IntArray,
    pictures: Callable[[IntArray], Iterable[VideoFrame]],
) -> PictureTurns:
    """Follow the bends of a video with frames ``frame`` [n] at stamps ``t_ns`` [n]; ``pictures``
    decodes those of these numbers, in order."""
    path = path_of(t_ns)
    ahead = rpy_to_matrix(camera.mount_rpy).T[:, 0]
    if path is None or abs(ahead[0]) < limits.LEAST_AHEAD:
        return PictureTurns(0)
    followed = [
        _follow(camera, ahead[1:] / ahead[0], pictures(frame[rows]))
        for rows in frames_to_follow(path, t_ns)
    ]
    return judged(
        camera, path_of, [steps for steps in followed if len(steps.turn) > limits.FEWEST_STEPS]
    )


def _follow(camera: Camera, ahead: FloatArray, pictures: Iterable[VideoFrame]) -> Steps:
    """Turns from picture to picture, without those of which nothing is known, or that stand still:
    what does not move in a bend is dirt, writing or a bus ahead, and no background."""
    motions = ImageMotion(camera, ahead)
    old, new, turn = [], [], []
    before: int | None = None
    for picture in pictures:
        seconds = 0.0 if before is None else (picture.t_ns - before) * 1e-9
        motion = motions.step(picture.image, seconds)
        told = motion.turn_sd < limits.TURN_RATE_SD * seconds and motion.moved.any()
        if before is not None and told:
            old.append(before)
            new.append(picture.t_ns)
            turn.append(matrix_to_rotation_vector(motion.C_new_old.T))
        before = picture.t_ns
    stamps = np.array(old, np.int64), np.array(new, np.int64)
    return Steps(*stamps, np.array(turn, np.float64).reshape(-1, 3))


def judged(camera: Camera, path_of: PathOf, bends: list[Steps]) -> PictureTurns:
    """What bends say together; nothing where less than two of them show how the picture turns."""
    offsets = np.arange(-limits.MOST_LATE_S, limits.MOST_LATE_S + 1e-9, limits.LATE_STEP_S)
    on_path = [_on_path(path_of, one, offsets) for one in bends]
    fits: list[_Bend] = []
    names: tuple[str, ...] = ()
    most = 0.0
    for looked, looks in _PICTURES:
        tried = [
            _fit(one, path @ looks.T, known, offsets)
            for one, (path, known) in zip(bends, on_path, strict=True)
        ]
        found = [fit for fit in tried if fit is not None]
        total = sum(fit.correlation for fit in found)
        if total > most:
            most, fits, names = total, found, looked
    # one bend may be of a lorry that crosses; none alike is a video of something else, if it bends
    if not any(fit.correlation > limits.UNLIKE_TURNS for fit in fits):
        return PictureTurns(0, unlike=sum(_bends(one) for one in bends))
    fits = [fit for fit in fits if fit.correlation > limits.ALIKE_TURNS]
    if len(fits) < limits.FEWEST_BENDS:
        return PictureTurns(len(fits))
    told = _combined(camera, fits, names)
    if told.allowed:
        return _unmoved(camera, told) if _may_follow(fits) else told
    more = np.sum([fit.followed - fit.correlation for fit in fits], axis=0)
    return _steadied(camera, told) if more.max() > 0.0 else told


def _may_follow(fits: list[_Bend]) -> bool:
    """Whether a low pass leaves no more of the turns than chance may make of a lag: twice the
    logarithm of the likelihoods' ratio, by what each leaves unexplained."""
    lag, slow = (np.array([getattr(f, n) for f in fits]) for n in ("correlation", "followed"))
    left = (1.0 - np.maximum(slow, 0.0) ** 2) / (1.0 - np.minimum(lag, 1.0 - 1e-9) ** 2)[:, None]
    alike = np.array([fit.turns / limits.STEPS_ALIKE for fit in fits])
    return bool(np.min(alike @ np.log(left)) < gate(limits.LATE_PROBABILITY, 1))


def _bends(steps: Steps) -> bool:
    """Whether pictures show a bend of their own: turns that last, as those of noise do not."""
    k, n = round(limits.STEPS_ALIKE), len(steps.turn) - len(steps.turn) % round(limits.STEPS_ALIKE)
    lasting = np.mean(steps.turn[:n].reshape(-1, k, 3).sum(axis=1) ** 2, axis=0)
    ratio = lasting / np.maximum(k * np.mean(steps.turn[:n] ** 2, axis=0), 1e-12)
    turned = np.ptp(np.cumsum(steps.turn, axis=0), axis=0) > limits.LEAST_BEND_RAD
    chance = [exceeds_ratio(float(one), n // k, n) for one in ratio]
    return bool(np.any(turned & (np.array(chance) < limits.LATE_PROBABILITY)))


def _steadied(camera: Camera, found: PictureTurns) -> PictureTurns:
    """Of a picture that follows the vehicle, and is not of another time: as unsure as it seems
    late."""
    if not found.offset_s:
        return found
    sd = float(np.hypot(found.offset_s, camera.time_offset_sd))
    return replace(found, offset_s=0.0, offset_sd_s=sd, rate=0.0)


def _unmoved(camera: Camera, found: PictureTurns) -> PictureTurns:
    """The same of a picture that may as well follow the vehicle: where it is stated to be, as
    unsure as it seems late if that is surer than stated."""
    sd = float(np.hypot(found.offset_s, found.offset_sd_s))
    if sd > camera.time_offset_sd:
        return PictureTurns(found.bends)
    return replace(found, offset_s=0.0, offset_sd_s=sd)


def _on_path(path_of: PathOf, steps: Steps, offsets: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Turns of the path [m, k, 3] at each offset [m], and where [m, k] they are known."""
    turn = np.zeros((len(offsets), len(steps.turn), 3))
    known = np.zeros(turn.shape[:2], np.bool_)
    for m, offset in enumerate(offsets.tolist()):
        shift = np.int64(round(offset * 1e9))
        both = path_of(np.concatenate([steps.old_ns, steps.new_ns]) + shift)
        if both is None:
            continue
        k = len(steps.turn)
        known[m] = both.known[:k] & both.known[k:]
        rows = np.flatnonzero(known[m])
        turn[m, rows] = _turns(both.C_cam_ref[rows], both.C_cam_ref[k + rows])
    return turn, known


def _turns(old: FloatArray, new: FloatArray) -> FloatArray:
    """Rotation vectors [k, 3] from attitudes ``old`` to ``new`` [k, 3, 3], in the old axes."""
    if not len(old):
        return np.zeros((0, 3))
    return np.asarray(matrix_to_rotation_vector(old @ np.swapaxes(new, 1, 2)))


def _fit(steps: Steps, path: FloatArray, known: BoolArray, offsets: FloatArray) -> _Bend | None:
    """Where one bend fits best, None at the end of what is searched or where the path ends."""
    if not known.all():
        return None
    with np.errstate(invalid="ignore", divide="ignore"):
        shared = np.einsum("kc,mkc->m", steps.turn, path)
        size = np.einsum("mkc,mkc->m", path, path)
        correlation = shared / np.sqrt(size * np.sum(steps.turn**2))
        # a low pass is a mean of what was before (a gimbal that follows its vehicle)
        age = -offsets / np.array(limits.FOLLOWED_S)[:, None]
        share = np.where(age >= 0.0, np.exp(-np.maximum(age, 0.0)), 0.0)
        slow = np.tensordot(share / share.sum(axis=1, keepdims=True), path, 1)
        followed = np.einsum("kc,fkc->f", steps.turn, slow)
        followed /= np.sqrt(np.einsum("fkc,fkc->f", slow, slow) * np.sum(steps.turn**2))
    at = int(np.nanargmax(np.nan_to_num(correlation, nan=-1.0)))
    if not 0 < at < len(offsets) - 1:
        return None
    low, top, high = correlation[at - 1 : at + 2]
    curve = low - 2.0 * top + high
    offset = offsets[at] + limits.LATE_STEP_S * float(0.5 * (low - high) / curve if curve else 0.0)
    # the pictures' scale is that of the lens, and is let go
    scale = shared[at] / size[at]
    residual = steps.turn - scale * path[at]
    slope = scale * (path[at + 1] - path[at - 1]) / (2.0 * limits.LATE_STEP_S)
    noise = np.sum(residual**2) / residual.size * limits.STEPS_ALIKE
    sd = float(np.hypot(np.sqrt(noise / np.sum(slope**2)), limits.LEAST_LATE_SD_S))
    middle = float(np.mean(0.5 * (steps.old_ns + steps.new_ns)))
    return _Bend(steps.turn.size, float(top), followed, float(offset), sd, middle)


def _combined(camera: Camera, fits: list[_Bend], names: tuple[str, ...]) -> PictureTurns:
    """Offset and pace of all bends: a straight line where it is needed, its sigma widened by how
    bends differ (Birge 1932). An offset that agrees with what the manifest states, and is surer, is
    combined with it by the variances of both."""
    offset, sd, at = (
        np.array([getattr(f, n) for f in fits]) for n in ("offset_s", "sd_s", "at_ns")
    )
    middle = float(np.average(at, weights=sd**-2.0))
    most = sigmas(limits.LATE_PROBABILITY)
    n, columns = len(fits), np.column_stack([np.ones(len(fits)), (at - middle) * 1e-9])
    for free in (2, 1) if n >= limits.FEWEST_BENDS + 1 else (1,):
        A = columns[:, :free] / sd[:, None]
        N = np.linalg.inv(A.T @ A)
        x = N @ A.T @ (offset / sd)
        scatter = np.sum((offset / sd - A @ x) ** 2) / max(n - free, 1)
        x_sd = np.sqrt(np.diag(N) * max(scatter, 1.0))
        if free == 2 and abs(x[1]) < most * x_sd[1]:
            continue
        late = abs(x[0]) > most * np.hypot(x_sd[0], camera.time_offset_sd)
        if free == 2 or late or names:
            rate = float(x[1]) if free == 2 else 0.0
            told = float(x[0]), float(x_sd[0]), rate
            return PictureTurns(n, round(middle), *told, names)
    # what bends have in common, their mean has as well
    sd_s = float(np.hypot(x_sd[0], limits.LEAST_LATE_SD_S))
    if sd_s > camera.time_offset_sd:
        return PictureTurns(n)
    variance = 1.0 / (sd_s**-2.0 + camera.time_offset_sd**-2.0)
    both = float(x[0]) * variance / sd_s**2, float(np.sqrt(variance))
    return PictureTurns(n, round(middle), *both, allowed=True)
