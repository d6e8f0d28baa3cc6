"""What else may be wrong with a camera than a small turn or a late stamp, and what its boxes say.

A picture that is mirrored or turned, a camera that looks backwards, a calibration of another
resolution, stamps of another clock, stamps that run too fast: each is a camera or a set of boxes
as they would be if that were so. All are compared by one evidence, before any box is linked: two
boxes of one sign and the way between them lie in one plane, and the ray turns away from the way
as the car comes nearer (epipolar constraint with positive depths: Hartley and Zisserman, Multiple
View Geometry, 2004, chapters 9 and 21). What turns and bends show decides; on the straight a
mirrored picture is as good as a right one, and on a level road high may as well be low.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from automap.effects.lens import focal_length
from automap.frames import matrix_to_rpy, rpy_to_matrix
from automap.gates import gate
from automap.geolocation import limits
from automap.geolocation.camera_doubt import as_unknown
from automap.geolocation.epipolar import PairGeometry, descend, pair_geometry
from automap.geolocation.track_evidence import Evidence
from automap.geolocation.views import map_origin
from automap.records import BoolArray, Camera, Detections, FloatArray, Trajectory

_PICTURE = "the picture is "
_FINER = 21
"""Values about the best of a grid, a tenth of its step apart."""


@dataclass(frozen=True)
class Hypothesis:
    """``what`` is wrong in words, and boxes and camera as they are then."""

    what: str
    found: Detections
    camera: Camera


@dataclass(frozen=True)
class _Judge:
    """Weighs hypotheses about one camera by the loss of its pairs of boxes."""

    trajectory: Trajectory
    origin: tuple[float, float, float]
    plain: Hypothesis
    """Boxes and camera as stated, with its turn and time offset let go."""
    out: BoolArray
    """Boxes [n] that say nothing of the camera."""

    def geometry(self, one: Hypothesis) -> PairGeometry:
        found = one.found.at(~self.out)
        whole = pair_geometry(self.trajectory, found, one.camera, self.origin)
        return whole.thinned(limits.HYPOTHESIS_PAIRS)

    def scale(self, one: Hypothesis, rad: float) -> float:
        """An angle of the stated camera as it is with another focal length: a box is off by as
        many pixels whatever the lens."""
        return rad * focal_length(self.plain.camera) / focal_length(one.camera)

    def loss(self, one: Hypothesis) -> float:
        """Mean loss of a pair after turn and time offset were let go; infinite without pairs."""
        geometry = self.geometry(one)
        if len(geometry) < limits.LEAST_PAIRS:
            return np.inf
        wide, narrow = (self.scale(one, rad) for rad in limits.SCALES_RAD[::2])
        starts = np.linspace(-limits.MOST_REACH_S, limits.MOST_REACH_S, 9)
        tried = [np.array([0.0, 0.0, 0.0, start]) for start in starts]
        x = min(tried, key=lambda at: mean_loss(geometry, at, wide))
        prior = np.array([limits.DOUBTED_TURN_RAD] * 3 + [limits.DOUBTED_TIME_S])
        for rad in limits.SCALES_RAD:
            x, _ = descend(x, geometry, prior, self.scale(one, rad))
        return mean_loss(geometry, x, narrow)


def mean_loss(geometry: PairGeometry, x: FloatArray, scale: float) -> float:
    """Cauchy's loss of a pair at a turn and time offset ``x`` [4], mean over all pairs."""
    way, one, other = geometry.rays(x)
    far = np.linalg.norm(way, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        along = way / far[:, None]
        normal = np.cross(along, one)
        length = np.linalg.norm(normal, axis=1)
        out = np.einsum("ni,ni->n", normal, other) / length
        # near the direction of driving the plane is not determined
        out[length < limits.FORWARD_SINE] = 0.0
        before, after = (
            np.arccos(np.clip(np.einsum("ni,ni->n", along, ray), -1.0, 1.0)) for ray in (one, other)
        )
        square = out**2 + np.maximum(before - after, 0.0) ** 2
    # from one place a sign is seen in one direction
    still = far < limits.PAIR_WAY_M
    square[still] = np.sum((one[still] - other[still]) ** 2, axis=1)
    ratio = np.nan_to_num(square / scale**2, nan=1e4)
    return float(np.log1p(ratio).mean())


def better_explanations(
    trajectory: Trajectory, found: Detections, camera: Camera, out: BoolArray | None = None
) -> list[Hypothesis]:
    """The hypotheses that explain the boxes of a camera better than a turn and a time offset do,
    by more than chance, the best first; those ``out`` [n] say nothing."""
    judge = _judge(trajectory, found, camera, out)
    plain = judge.plain
    others = [*_mountings(plain), *_calibrations(plain), *_best_pace(judge)]
    gains, tried = _gains(judge, others)
    least = gate(limits.START_PROBABILITY / max(len(tried), 1), 4)
    order = sorted(range(len(tried)), key=lambda k: -gains[k])
    return [tried[k] for k in order if gains[k] > least]


def _gains(judge: _Judge, others: list[Hypothesis]) -> tuple[list[float], list[Hypothesis]]:
    """By how much pictures, late and left out frames and ``others`` explain boxes better; none
    where nothing tells."""
    plain = judge.plain
    start = judge.loss(plain)
    if not np.isfinite(start):
        return [], []
    geometry = judge.geometry(plain)

    def late(offset_s: float, scale: float) -> float:
        return mean_loss(geometry, np.array([0.0, 0.0, 0.0, offset_s]), scale)

    length_s = float(np.ptp(judge.trajectory.t_ns)) * 1e-9
    offset = _best_in_time(
        min(limits.MOST_SHIFT_S, 0.5 * length_s), 2.0 * limits.START_STEP_S, late
    )
    tried = [
        *_pictures(plain), _shifted(plain, offset), *_strided(plain, length_s), *others,
    ]  # fmt: skip
    # a box has many pairs, which repeat its evidence
    return [(start - judge.loss(one)) * geometry.n_boxes for one in tried], tried


def _best_pace(judge: _Judge) -> Iterator[Hypothesis]:
    """The boxes at the pace of stamps that fits best; the search takes as long as the drive."""
    plain = judge.plain
    geometry = judge.geometry(plain)
    if not geometry.n_boxes:
        return

    def fast(rate: float, scale: float) -> float:
        return mean_loss(geometry.paced(rate), np.zeros(4), scale)

    # a step moves the last frame by two of offsets
    step = 4.0 * limits.START_STEP_S / max(float(np.ptp(plain.found.t_ns)) * 1e-9, 1.0)
    yield _paced(plain, _best_in_time(limits.MOST_RATE, step, fast))


def _judge(
    trajectory: Trajectory, found: Detections, camera: Camera, out: BoolArray | None
) -> _Judge:
    plain = Hypothesis("", found, as_unknown(camera))
    none = np.zeros(len(found), np.bool_) if out is None else out
    return _Judge(trajectory, map_origin(trajectory), plain, none)


def contradicted(
    trajectory: Trajectory, found: Detections, camera: Camera, out: BoolArray | None = None
) -> bool:
    """Whether the boxes of a camera fit so much better in a mirrored or turned picture, or with
    late or left out frames, than as stated as chance makes no more than once in a million cameras:
    such boxes may well be linked to signs, only elsewhere. Those ``out`` [n] say nothing."""
    judge = _judge(trajectory, found, camera, out)
    gains, tried = _gains(judge, [])
    if not tried:
        return False
    best = int(np.argmax(gains))
    late_s = float(np.abs(tried[best].found.t_ns - found.t_ns).max()) * 1e-9
    # what a time offset reaches is estimated in any case, and errors of the path look like it
    beyond = late_s == 0.0 or late_s > limits.MOST_REACH_S
    return beyond and gains[best] > gate(limits.MISFIT_PROBABILITY / len(tried), 4)


def in_picture(
    trajectory: Trajectory, found: Detections, camera: Camera, pictures: tuple[str, ...]
) -> Detections:
    """The boxes of a camera whose picture is one of ``pictures``, as they are in that of these
    that they fit best; as they are where there is none."""
    judge = _judge(trajectory, found, camera, None)
    tried = [one for one in _pictures(judge.plain) if one.what.removeprefix(_PICTURE) in pictures]
    return min(tried, key=judge.loss).found if tried else found


def _pictures(plain: Hypothesis) -> Iterator[Hypothesis]:
    """The boxes as they are if the picture is mirrored or turned."""
    wide, high = plain.camera.width - 1.0, plain.camera.height - 1.0
    left, top, right, bottom = np.asarray(plain.found.box, np.float64).reshape(-1, 4).T
    for what, box in (
        ("mirrored", (wide - right, top, wide - left, bottom)),
        ("upside down", (wide - right, high - bottom, wide - left, high - top)),
        (
            "upside down and mirrored, as where rows count from the bottom",
            (left, high - bottom, right, high - top),
        ),
        ("turned to the left", (wide - bottom, left, wide - top, right)),
        ("turned to the right", (top, high - right, bottom, high - left)),
    ):
        yield replace(
            plain,
            what=_PICTURE + what,
            found=replace(plain.found, box=np.column_stack(box)),
        )


def _mountings(plain: Hypothesis) -> Iterator[Hypothesis]:
    """The camera as it is if it looks elsewhere, or lies on its side."""
    stated = rpy_to_matrix(plain.camera.mount_rpy)
    for what, rpy_deg, first in (
        ("looks the other way", (0.0, 0.0, 180.0), True),
        ("looks a right angle to the right", (0.0, 0.0, 90.0), True),
        ("looks a right angle to the left", (0.0, 0.0, -90.0), True),
        ("is rolled by 90 deg", (90.0, 0.0, 0.0), False),
        ("is rolled by -90 deg", (-90.0, 0.0, 0.0), False),
    ):
        turn = rpy_to_matrix(np.radians(rpy_deg))
        mount = matrix_to_rpy(turn @ stated if first else stated @ turn)
        camera = replace(plain.camera, mount_rpy=mount)
        yield replace(plain, what=f"the camera {what} against mount_rpy_deg", camera=camera)


def _calibrations(plain: Hypothesis) -> Iterator[Hypothesis]:
    """The camera as it is if its calibration is of another resolution or of another zoom."""
    for factor in limits.OTHER_SCALES:
        for whole in (True, False):
            matrix = plain.camera.matrix.copy()
            matrix[:2, : 3 if whole else 2] *= factor
            what = "camera_matrix" if whole else "the focal length in camera_matrix"
            yield replace(
                plain,
                what=f"{what} is {factor:.2f} of what is stated",
                camera=replace(plain.camera, matrix=matrix),
            )


def explanation_by_tracks(plain: Hypothesis, told: Evidence, late_s: float) -> list[Hypothesis]:
    """What tracks say that is wrong with a camera, of frames that were found ``late_s`` from their
    stamps: its focal length, or that all its frames are of another time by seconds, or at another
    pace."""
    found = []
    if told.is_paced and told.paced > told.late:
        found.append(_paced(plain, told.rate, late_s + told.begin_s))
    elif told.is_late:
        found.append(_shifted(plain, late_s + told.late_s))
    if told.is_zoomed:
        matrix = plain.camera.matrix.copy()
        matrix[:2, :2] *= told.factor
        what = f"the focal length in camera_matrix is {told.factor:.2f} of what is stated"
        found.append(replace(plain, what=what, camera=replace(plain.camera, matrix=matrix)))
    return found


def _shifted(plain: Hypothesis, offset_s: float) -> Hypothesis:
    t_ns = plain.found.t_ns + np.int64(round(offset_s * 1e9))
    found = replace(plain.found, t_ns=t_ns)
    return replace(plain, what=f"the frames are {offset_s:+.1f} s from their stamps", found=found)


def _paced(plain: Hypothesis, rate: float, begin_s: float = 0.0) -> Hypothesis:
    since = plain.found.t_ns - plain.found.t_ns.min()
    late = np.round(rate * since + begin_s * 1e9).astype(np.int64)
    what = f"the frames take {1.0 + rate:.4f} of the time that their stamps say"
    return replace(plain, what=what, found=replace(plain.found, t_ns=plain.found.t_ns + late))


def _strided(plain: Hypothesis, length_s: float) -> Iterator[Hypothesis]:
    """The boxes as they are if a detector saw every second frame, or every third, and numbered
    those that it saw one after another, as far as the path of ``length_s`` goes on for that."""
    frame, t_ns = plain.found.frame, plain.found.t_ns
    period_ns = np.ptp(t_ns) / max(int(np.ptp(frame)), 1)
    for stride in range(2, limits.MOST_STRIDE + 1):
        late_ns = (stride - 1) * period_ns * frame
        if np.ptp(t_ns + late_ns) > length_s * 1e9:
            return
        found = replace(plain.found, t_ns=t_ns + np.round(late_ns).astype(np.int64))
        what = f"frame 1 of its boxes is frame {stride} of the video, and so on"
        yield replace(plain, what=what, found=found)


def _best_in_time(reach: float, step: float, loss: Callable[[float, float], float]) -> float:
    """The best value of one family of stamps up to ``reach`` on either side, by a look at one each
    ``step`` and a finer one about the best; ``loss`` of a value with a scale in rad."""
    n = int(reach / step)
    wide, narrow = limits.SCALES_RAD[:2]
    best: float = min((step * np.arange(-n, n + 1.0)).tolist(), key=lambda value: loss(value, wide))
    finer = best + step * np.linspace(-1.0, 1.0, _FINER)
    result: float = min(finer.tolist(), key=lambda value: loss(value, narrow))
    return result
