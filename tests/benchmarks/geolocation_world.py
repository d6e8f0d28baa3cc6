"""Ten-minute drives past signs, with everything that goes wrong: for geolocation alone.

The truth is exact; the trajectory given to geolocation carries position and attitude errors
that wander (second-order Gauss-Markov, so that the velocity error is finite), boxes are noisy,
missed and of the wrong class, clutter is added, and the camera is turned and late by amounts
that its manifest does not know.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from automap.earth import from_local_ned, local_ned
from automap.frames import rpy_to_matrix
from automap.records import Camera, Detections, FloatArray, IntArray, SignPoints, Trajectory

ORIGIN = (np.radians(-35.3), np.radians(149.1), 580.0)
CLASSES = tuple(f"sign-{k}" for k in range(12))
_FACE_COSINE = 0.5
ODD_SIZE = 1.5
CLASS_SIZE_M = 0.5 + 0.05 * np.arange(12.0)


@dataclass(frozen=True)
class Difficulty:
    """What is wrong: lengths in m, angles in deg, times in s, the rest shares.

    ``position_sd`` and ``yaw_sd`` of the trajectory wander with ``tau_s``; ``tilt_sd`` of roll
    and pitch. ``box_px`` and ``box_share`` (of the height) a side of a box; ``mount_deg``
    [3] and ``late_s`` the camera's true turn and offset, ``focal`` its relative focal error.
    ``box_alike`` correlation of the errors of a sign's boxes from frame to frame, ``box_freedom``
    of Student's t that they follow (infinite: normal), ``odd_sizes`` of the signs are 1.5 times
    larger or smaller than their class. Faces look against the traffic but for turns of the
    distribution ``turned`` ("normal", "uniform", "laplace", "some": a tenth by up to 55 deg) of
    standard deviation ``turned_deg``; ``faces`` names of the classes in place of ``CLASSES``.
    ``margin_px`` sd of what all boxes of a sign are too wide and too tall by, ``wide`` of the
    logarithm of width over height from sign to sign; ``box_alike`` and ``box_freedom`` hold for
    widths too.
    """

    position_sd: float = 1.0
    height_sd: float = 1.5
    tau_s: float = 60.0
    tilt_sd: float = 0.05
    yaw_sd: float = 0.2
    box_px: float = 1.0
    box_share: float = 0.02
    missed: float = 0.25
    wrong_class: float = 0.1
    clutter: float = 0.1
    mount_deg: tuple[float, float, float] = (1.0, -2.0, 3.0)
    mount_sd_deg: float = 3.0
    late_s: float = 0.1
    late_sd_s: float = 0.15
    focal: float = 0.0
    duration_s: float = 600.0
    spacing_s: float = 3.0
    twice: bool = True
    box_alike: float = 0.0
    box_freedom: float = np.inf
    odd_sizes: float = 0.0
    turned: str = "normal"
    turned_deg: float = 0.0
    faces: tuple[str, ...] = CLASSES
    margin_px: float = 0.0
    wide: float = 0.0


@dataclass(frozen=True)
class World:
    """A drive: ``trajectory`` as geolocation gets it, ``true`` as it was; ``detections`` with
    the sign each box shows in ``owner`` (-1 clutter); signs ``position`` [m, 3] NED at ORIGIN
    with ``class_name``, ``size`` in m and ``facing`` in rad clockwise from north; ``camera`` as in
    the manifest, ``true_camera`` as it is."""

    trajectory: Trajectory
    true: Trajectory
    detections: Detections
    owner: IntArray
    position: FloatArray
    class_name: tuple[str, ...]
    size: FloatArray
    facing: FloatArray
    camera: Camera
    true_camera: Camera


def _wander(rng: np.random.Generator, t: FloatArray, sd: float, tau_s: float) -> FloatArray:
    """Second-order Gauss-Markov process [n] of stationary ``sd``, correlation about ``tau_s``."""
    rate = 2.0 / tau_s
    dt = 0.5
    n = int(np.ceil(t[-1] / dt)) + 2
    a = np.exp(-rate * dt)
    Phi = np.array([[1 + rate * dt, dt], [-(rate**2) * dt, 1 - rate * dt]]) * a
    P = np.diag([1.0, rate**2])
    root = np.linalg.cholesky(P - Phi @ P @ Phi.T + 1e-15 * np.eye(2))
    x = np.zeros((n, 2))
    x[0] = np.sqrt(np.diag(P)) * rng.normal(size=2)
    for k in range(1, n):
        x[k] = Phi @ x[k - 1] + root @ rng.normal(size=2)
    from scipy.interpolate import CubicHermiteSpline

    return np.asarray(sd * CubicHermiteSpline(np.arange(n) * dt, x[:, 0], x[:, 1])(t))


def _route(rng: np.random.Generator, d: Difficulty, rate: float) -> tuple[FloatArray, ...]:
    """Times, positions [n, 3], yaw and speed: town blocks, the second half over the first's
    streets again when ``twice``."""
    t = np.arange(0.0, d.duration_s, 1.0 / rate)
    half = 0.5 * d.duration_s if d.twice else d.duration_s
    turn = np.zeros_like(t)
    # eight right turns bring a lap back to where and how it began
    at = half / 16.0 - 2.0 if d.twice else 25.0
    while at < half - (0.0 if d.twice else 20.0):
        side = 1.0 if d.twice or rng.random() < 0.5 else -1.0
        during = (t >= at) & (t < at + 4.0)
        turn[during] = side * (np.pi / 2) / 4.0
        at += half / 8.0 if d.twice else rng.uniform(25.0, 45.0)
    speed = 11.0 + 3.0 * np.sin(2 * np.pi * t / 47.0)
    if d.twice:
        again = t >= half
        turn[again] = np.interp(t[again] - half, t, turn)
        speed[again] = np.interp(t[again] - half, t, speed)
    yaw = 0.4 + np.cumsum(turn) / rate
    velocity = speed[:, None] * np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)])
    place = np.cumsum(velocity, axis=0) / rate
    if d.twice:
        # the loop closes: the residue is taken off evenly, the velocity stays consistent
        period = int(half * rate)
        if period < len(t):
            drift = (place[period] - place[0]) / period
            place -= drift * np.arange(len(t))[:, None]
            velocity = velocity - drift * rate
            # a car goes where it points
            yaw = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    return t, place, yaw, velocity


def true_points(world: World) -> SignPoints:
    """The signs that have two boxes at least."""
    seen = np.bincount(world.owner[world.owner >= 0], minlength=len(world.position)) >= 2
    lat, lon, _ = from_local_ned(world.position[seen], ORIGIN)
    names = np.array(world.class_name, np.object_)[seen]
    n = len(names)
    return SignPoints(
        np.asarray(lat), np.asarray(lon), names, np.full((n, 2, 2), np.nan), np.zeros(n)
    )


def make_world(
    seed: int, d: Difficulty | None = None, rate: float = 50.0, errors_seed: int | None = None
) -> World:
    """One drive; everything random comes from ``seed``.

    With ``errors_seed`` the errors and boxes come from both, street and signs from ``seed``
    alone: another drive past the same signs.
    """
    d = d or Difficulty()
    rng = np.random.default_rng(seed)
    errors = rng if errors_seed is None else np.random.default_rng([seed, errors_seed])
    t, place, yaw, velocity = _route(rng, d, rate)
    rpy = np.column_stack([np.zeros_like(yaw), 0.01 * np.sin(t / 9.0), yaw])
    true = _trajectory(t, place, velocity, rpy, d)
    late = np.column_stack(
        [_wander(errors, t, s, d.tau_s) for s in (d.position_sd, d.position_sd, d.height_sd)]
    )
    tilt = np.radians(
        np.column_stack([_wander(errors, t, s, d.tau_s) for s in (d.tilt_sd, d.tilt_sd, d.yaw_sd)])
    )
    given = _trajectory(
        t, place + late, velocity + np.gradient(late, 1.0 / rate, axis=0), rpy + tilt, d
    )
    position, kind, size, approach = _signs(rng, d, t, place, yaw)
    camera, true_camera = _cameras(d)
    facing = np.arctan2(-approach[:, 1], -approach[:, 0]) + np.radians(_turns(seed, d, len(kind)))
    detections, owner = _boxes(errors, d, true, true_camera, position, kind, size, facing)
    names = tuple(d.faces[k] for k in kind)
    return World(given, true, detections, owner, position, names, size, facing, camera, true_camera)


def _turns(seed: int, d: Difficulty, n: int) -> FloatArray:
    """Degrees [n] by which faces are turned from the direction against the traffic."""
    rng = np.random.default_rng([seed, 1])  # of its own: the rest is the same however they turn
    if d.turned == "uniform":
        return rng.uniform(-1.0, 1.0, n) * np.sqrt(3.0) * d.turned_deg
    if d.turned == "laplace":
        return rng.laplace(0.0, d.turned_deg / np.sqrt(2.0), n)
    turns = d.turned_deg * rng.normal(size=n)
    some = rng.random(n) < (0.1 if d.turned == "some" else 0.0)
    return np.where(some, rng.uniform(-55.0, 55.0, n), turns)


def _trajectory(
    t: FloatArray, place: FloatArray, velocity: FloatArray, rpy: FloatArray, d: Difficulty
) -> Trajectory:
    lat, lon, height = from_local_ned(place, ORIGIN)
    one = np.ones((len(t), 3))
    return Trajectory(
        t_ns=(1e12 + np.rint(t * 1e9)).astype(np.int64),
        gps_s=1.4e9 + t,
        lat_rad=np.asarray(lat),
        lon_rad=np.asarray(lon),
        height_m=np.asarray(height),
        vel_ned=velocity,
        rpy=rpy,
        sd_pos_ned=one * [d.position_sd, d.position_sd, d.height_sd],
        sd_vel_ned=one * np.array([d.position_sd, d.position_sd, d.height_sd]) * 2.0 / d.tau_s,
        sd_rpy=one * np.radians([d.tilt_sd, d.tilt_sd, d.yaw_sd]),
    )


def _signs(
    rng: np.random.Generator, d: Difficulty, t: FloatArray, place: FloatArray, yaw: FloatArray
) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    """Signs along the first lap: either side, some in pairs 1.5 m apart; with the direction
    [m, 2] in which the traffic drives that they are for."""
    rate = 1.0 / (t[1] - t[0])
    last = 0.5 * d.duration_s if d.twice else d.duration_s
    times = np.arange(4.0, last - 3.0, d.spacing_s) + rng.uniform(
        -0.8, 0.8, len(np.arange(4.0, last - 3.0, d.spacing_s))
    )
    rows = (times * rate).astype(np.int64)
    side = np.where(rng.random(len(rows)) < 0.6, -1.0, 1.0) * rng.uniform(3.0, 7.0, len(rows))
    across = np.column_stack([-np.sin(yaw[rows]), np.cos(yaw[rows])])
    along = np.column_stack([np.cos(yaw[rows]), np.sin(yaw[rows])])
    position = np.column_stack(
        [place[rows, :2] + side[:, None] * across, -rng.uniform(1.2, 2.6, len(rows))]
    )
    kind = rng.integers(0, len(CLASSES), len(rows))
    double = rng.random(len(rows)) < 0.15
    beside = position[double].copy()
    beside[:, :2] += 1.5 * np.where(
        rng.random((double.sum(), 1)) < 0.5, along[double], across[double]
    )
    position = np.vstack([position, beside])
    kind = np.concatenate([kind, rng.integers(0, len(CLASSES), double.sum())])
    size = CLASS_SIZE_M[kind] * np.exp(rng.normal(0.0, 0.05, len(kind)))
    if d.odd_sizes:
        odd = rng.random(len(kind)) < d.odd_sizes
        size[odd] *= ODD_SIZE ** rng.choice([-1.0, 1.0], odd.sum())
    return position, kind, size, np.vstack([along, along[double]])


def _cameras(d: Difficulty) -> tuple[Camera, Camera]:
    def camera(focal: float, mount: FloatArray, offset: float) -> Camera:
        return Camera(
            width=1280,
            height=720,
            matrix=np.array([[focal, 0.0, 640.0], [0.0, focal, 360.0], [0.0, 0.0, 1.0]]),
            distortion=np.zeros(5),
            lever_arm_m=np.array([1.4, 0.1, -0.6]),
            mount_rpy=mount,
            mount_sd=float(np.radians(d.mount_sd_deg)),
            time_offset_s=offset,
            time_offset_sd=d.late_sd_s,
        )

    return (
        camera(1000.0, np.zeros(3), 0.0),
        camera(1000.0 * (1.0 + d.focal), np.radians(d.mount_deg), d.late_s),
    )


def _box_errors(
    rng: np.random.Generator, d: Difficulty, frame: IntArray, sign: IntArray
) -> FloatArray:
    """Errors [n, 3] of boxes in sigmas: right, down and height, in the order of the frames.

    A first-order process through the boxes of a sign in one pass (a silence of 20 frames ends it),
    whose values are then given the tails of Student's t.
    """
    from scipy.stats import norm
    from scipy.stats import t as student

    n = len(frame)
    error = np.column_stack([rng.normal(size=(n, 2)), rng.normal(size=n)])
    if d.box_alike:
        order = np.lexsort((frame, sign))
        for before, now in itertools.pairwise(order):
            if sign[before] == sign[now] and frame[now] - frame[before] <= 20:
                fresh = np.sqrt(1.0 - d.box_alike**2)
                error[now] = d.box_alike * error[before] + fresh * error[now]
    if np.isfinite(d.box_freedom):
        error = student.ppf(norm.cdf(error), d.box_freedom)
    return np.asarray(error)


def _widths(
    frame: IntArray,
    sign: IntArray,
    height: FloatArray,
    sd: FloatArray,
    d: Difficulty,
    C_ref_cam: FloatArray,
    q: FloatArray,
    facing: FloatArray,
) -> FloatArray:
    """Widths [n] px of the boxes of round faces, from points all round each face.

    ``height`` [n] px of the bare boxes and ``sd`` [n] px of one side; ``C_ref_cam`` [f, 3, 3] and
    ``q`` [f, m, 3] of all frames and signs; ``facing`` [m].
    """
    rng = np.random.default_rng([len(frame), 2])
    angle = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    across = np.column_stack([-np.sin(facing), np.cos(facing), np.zeros(len(facing))])[sign]
    # the face's radius is half its height, which is that of the boxes at the sign's distance
    radius = 0.5 * height * q[frame, sign, 0] / 1000.0
    rim = np.cos(angle)[:, None] * across[:, None] - np.sin(angle)[:, None] * [0.0, 0.0, 1.0]
    rim = np.einsum("nji,nkj->nki", C_ref_cam[frame], rim * radius[:, None, None])
    rim += q[frame, sign][:, None]
    flat = rim[..., 1:] / rim[..., :1]
    extent = flat.max(axis=1) - flat.min(axis=1)
    error = _box_errors(rng, d, frame, sign)[:, 0] * sd
    wide = extent[:, 0] / extent[:, 1] * np.exp(d.wide * rng.normal(size=len(facing)))[sign]
    return np.asarray(wide * height + error)


def _boxes(
    rng: np.random.Generator,
    d: Difficulty,
    true: Trajectory,
    view: Camera,
    position: FloatArray,
    kind: IntArray,
    size: FloatArray,
    facing: FloatArray,
    interval_s: float = 0.2,
    range_m: tuple[float, float] = (5.0, 55.0),
) -> tuple[Detections, IntArray]:
    """Boxes of the detector; the frame stamps lack the camera's time offset."""
    step = round(interval_s / ((true.t_ns[1] - true.t_ns[0]) * 1e-9))
    rows = np.arange(0, len(true), step)
    body = local_ned(true.lat_rad[rows], true.lon_rad[rows], true.height_m[rows], ORIGIN)
    C = rpy_to_matrix(true.rpy[rows])
    centre = body + C @ view.lever_arm_m
    towards = position[None] - centre[:, None]
    q = np.einsum("nji,nmj->nmi", C @ rpy_to_matrix(view.mount_rpy), towards)
    # only cameras in front of it see a sign's face
    plan = towards[..., :2] / np.maximum(np.linalg.norm(towards[..., :2], axis=2), 0.1)[..., None]
    normal = np.column_stack([np.cos(facing), np.sin(facing)])
    faces = -np.einsum("nmi,mi->nm", plan, normal) > _FACE_COSINE
    focal, (cx, cy) = view.matrix[0, 0], view.matrix[:2, 2]
    depth = np.where(q[..., 0] > 1.0, q[..., 0], np.nan)
    x, y = focal * q[..., 1] / depth + cx, focal * q[..., 2] / depth + cy
    height = focal * size[None] / depth
    with np.errstate(invalid="ignore"):
        seen = faces & (depth > range_m[0]) & (depth < range_m[1])
        seen &= np.abs(x - 0.5 * view.width) < 0.5 * view.width - height
        seen &= np.abs(y - 0.5 * view.height) < 0.5 * view.height - height
    seen &= rng.random(seen.shape) >= d.missed
    frame, sign = np.nonzero(seen)
    n = len(frame)
    h = height[frame, sign]
    sd = np.hypot(d.box_px, d.box_share * h)
    off = _box_errors(rng, d, frame, sign)
    middle = np.column_stack([x[frame, sign], y[frame, sign]]) + sd[:, None] * off[:, :2]
    loose = d.margin_px * np.random.default_rng([n, 3]).normal(size=(len(size), 2))[sign]
    tall = np.maximum(h + sd * off[:, 2] + loose[:, 1], 3.0)
    bare = _widths(frame, sign, h, sd, d, C @ rpy_to_matrix(view.mount_rpy), q, facing)
    wide = np.maximum(bare + loose[:, 0], 2.0)
    names = np.array([d.faces[k] for k in kind], np.object_)[sign]
    wrong = rng.random(n) < d.wrong_class
    names[wrong] = rng.choice(d.faces, wrong.sum())
    extra = rng.poisson(d.clutter, len(rows))
    clutter_frame = np.repeat(np.arange(len(rows)), extra)
    m = len(clutter_frame)
    frame = np.concatenate([frame, clutter_frame])
    owner = np.concatenate([sign, np.full(m, -1)])
    middle = np.vstack(
        [middle, rng.uniform([60, 120], [view.width - 60, view.height - 200], (m, 2))]
    )
    tall = np.concatenate([tall, np.exp(rng.uniform(np.log(12), np.log(70), m))])
    wide = np.concatenate([wide, tall[n:]])
    names = np.concatenate([names, rng.choice(d.faces, m).astype(np.object_)])
    score = np.concatenate([rng.uniform(0.6, 1.0, n), rng.uniform(0.3, 0.8, m)])
    order = np.argsort(frame, kind="stable")
    half = 0.5 * np.column_stack([wide, tall])
    box = np.hstack([middle - half, middle + half])
    stamps = true.t_ns[rows] - round(view.time_offset_s * 1e9)
    return (
        Detections(
            frame=frame[order],
            t_ns=stamps[frame[order]],
            class_name=names[order],
            box=box[order],
            score=score[order],
            track=np.full(n + m, -1, np.int64),
        ),
        owner[order].astype(np.int64),
    )
