"""The path where a vehicle drove without inertial readings: by the fixes alone.

A logger that hung, started late or was full before the drive ended leaves out minutes of readings.
The fixes of these minutes are as good as those of a drive without a sensor. Between readings the
filter goes on with ones that are made up of them, before and behind all readings the path is that
of the fixes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from automap.earth import local_ned
from automap.fusion import limits
from automap.fusion.aside import whole_trajectory
from automap.fusion.doubts.reason import Reason
from automap.fusion.limits import DRIVING_SPEED, MOVING_SPEED, SHORT_GAP_S, TRIAL_MOVING_S
from automap.gates import gate
from automap.interpolation import LONGEST_GAP_S
from automap.records import FloatArray, ImuData, IntArray, Trajectory
from automap.timebase import gps_to_iso


def over_holes(imu: ImuData, alone: Trajectory) -> tuple[ImuData, FloatArray]:
    """The recording with readings made up in holes between readings that are too long for poses
    between them, and the PSD [n, 2] of what force and rate err by there, zero elsewhere.

    The vehicle turns as its course does on the path of the fixes ``alone``, about the direction in
    which it feels gravity: a line over the hole may turn it anywhere, and what follows begins with
    the wrong heading. Readings made so err as they do where the sensor was read. What was read
    before the first piece that tells the heading is left out.
    """
    imu = _from_first_drive(imu, alone)
    at = unread(alone, imu.t_ns)
    at = at.at(np.flatnonzero((at.t_ns > imu.t_ns[0]) & (at.t_ns < imu.t_ns[-1])))
    step_ns = round(SHORT_GAP_S * 1e9)
    at = at.at(np.unique((at.t_ns - imu.t_ns[0]) // step_ns, return_index=True)[1])
    if not len(at):
        return imu, np.zeros((len(imu), 2))
    psd = _made_noise(imu, alone)
    gyro, accel = _made(imu, alone, at.t_ns)
    t_ns = np.concatenate([imu.t_ns, at.t_ns])
    order = np.argsort(t_ns, kind="stable")
    t_ns = t_ns[order]
    whole = replace(
        imu,
        t_ns=t_ns,
        gyro=np.concatenate([imu.gyro, gyro])[order],
        accel=np.concatenate([imu.accel, accel])[order],
        temp_c=None if imu.temp_c is None else np.interp(t_ns, imu.t_ns, imu.temp_c),
    )
    # the step from the last reading to the first of these is as unsure
    unsure = order >= len(imu)
    unsure[:-1] |= unsure[1:]
    return whole, unsure[:, None] * psd


def lost_holes(
    read_s: FloatArray, fix_s: FloatArray, lat_rad: FloatArray, lon_rad: FloatArray, sd_m: float
) -> list[tuple[float, float, float]]:
    """From and until when neither readings at ``read_s`` [n] nor fixes at ``fix_s`` [k] tell
    anything, for so long that no state is left to go on from, and by how many m the vehicle moved
    meanwhile, by fixes good to ``sd_m`` m an axis."""
    known = np.union1d(read_s, fix_s)
    found = []
    for k in np.flatnonzero(np.diff(known) > limits.MOST_LOST_S).tolist():
        behind = int(np.searchsorted(fix_s, known[k], side="right"))
        if 0 < behind < len(fix_s):
            here, there = behind - 1, behind
            ref = float(lat_rad[here]), float(lon_rad[here]), 0.0
            way = local_ned(lat_rad[there], lon_rad[there], 0.0, ref).ravel()[:2]
            square = float((way**2).sum())
            if square > gate(limits.DOUBT_PROBABILITY, 2) * 2.0 * sd_m**2:
                found.append((float(known[k]), float(known[k + 1]), math.sqrt(square)))
    return found


def longest_trip(imu: ImuData, alone: Trajectory) -> tuple[ImuData, list[str]]:
    """The recording of the trip that is driven for longest, of those between ``lost_holes``, and
    what is to be told of the others; ``alone`` the path of the fixes."""
    fix_s, read_s = ((t - alone.t_ns[0]) * 1e-9 for t in (alone.t_ns, imu.t_ns))
    sd_m = float(np.sqrt(np.median(alone.sd_pos_ned[:, :2] ** 2)))
    holes = lost_holes(read_s, fix_s, alone.lat_rad, alone.lon_rad, sd_m)
    if not holes:
        return imu, []
    edges = [end - 0.5e-9 for _, end, _ in holes]
    moves = np.hypot(alone.vel_ned[:, 0], alone.vel_ned[:, 1]) > MOVING_SPEED
    trip = np.searchsorted(edges, fix_s[moves])
    read = np.searchsorted(edges, read_s)
    # of trips without readings none
    count = np.bincount(trip, minlength=len(edges) + 1)
    driven = np.where(np.isin(range(len(edges) + 1), read), count, -1)
    rows = np.flatnonzero(read == np.argmax(driven))
    begin, end, metres = max(holes, key=lambda hole: hole[1] - hole[0])
    more = f" and {len(holes) - 1} more" if len(holes) > 1 else ""
    told = (
        f"for {(end - begin) / 60.0:.0f} min from {gps_to_iso(float(alone.gps_s[0]) + begin)} on "
        f"there are neither readings nor fixes{more}, and the vehicle was moved by {metres:.0f} m: "
        "nothing tells how it stands behind. The IMU is read on the longest trip alone, the path "
        "of the others is that of their fixes; cut the recording there, into a drive for each trip"
    )
    return imu.at(slice(int(rows[0]), int(rows[-1]) + 1)), [told]


def _from_first_drive(imu: ImuData, alone: Trajectory) -> ImuData:
    """The recording from the first piece between holes on behind whose start most of the driving
    that headings are tried over was read, by the path of the fixes ``alone``; or the most."""
    holes = np.flatnonzero(np.diff(imu.t_ns) > LONGEST_GAP_S * 1e9)
    first, last = np.append(0, holes + 1), np.append(holes, len(imu) - 1)
    moves = np.hypot(alone.vel_ned[:, 0], alone.vel_ned[:, 1]) > MOVING_SPEED
    driven = np.cumsum(np.where(moves, np.diff(alone.gps_s, prepend=alone.gps_s[0]), 0.0))
    at_first, at_last = (np.interp(imu.t_ns[k], alone.t_ns, driven) for k in (first, last))
    # seconds of driving that were read, before each end of a piece
    ends = np.column_stack([at_first, at_last]).ravel()
    before = np.cumsum(np.column_stack([np.zeros(len(first)), at_last - at_first]).ravel())
    read = np.interp(at_first + TRIAL_MOVING_S, ends, before) - before[::2]
    return imu.at(slice(first[np.argmax(np.minimum(read, 0.5 * TRIAL_MOVING_S))], None))


def _made(imu: ImuData, alone: Trajectory, t_ns: IntArray) -> tuple[FloatArray, FloatArray]:
    """Rate and force [k, 3] that the path of the fixes ``alone`` lets expect at stamps [k]."""
    half = round(0.5 * SHORT_GAP_S * 1e9)
    course = np.unwrap(alone.rpy[:, 2])
    after, before = (np.interp(t_ns + way, alone.t_ns, course) for way in (half, -half))
    force = imu.accel.mean(axis=0)
    turn = (after - before)[:, None] / SHORT_GAP_S * force / np.linalg.norm(force)
    return np.median(imu.gyro, axis=0) - turn, np.broadcast_to(force, turn.shape)


def _made_noise(imu: ImuData, alone: Trajectory) -> FloatArray:
    """PSD [2] of force and rate by which readings differ from made ones for some seconds."""
    block = (imu.t_ns - imu.t_ns[0]) // round(LONGEST_GAP_S * 1e9)
    rows = np.flatnonzero(np.diff(block, prepend=-1))
    count = np.diff(rows, append=len(block))[:, None]
    gyro, accel = (
        np.add.reduceat(read - made, rows) / count
        for read, made in zip((imu.gyro, imu.accel), _made(imu, alone, imu.t_ns), strict=True)
    )
    return LONGEST_GAP_S * np.array([(part**2).mean(axis=0).max() for part in (accel, gyro)])


def unread(alone: Trajectory, t_ns: IntArray) -> Trajectory:
    """The rows of the path of the fixes ``alone`` in holes between readings at ``t_ns`` [n] that
    are too long for poses between them, or that far before the first or behind the last reading."""
    first, last = min(alone.t_ns[0], t_ns[0]), max(alone.t_ns[-1], t_ns[-1])
    edges = np.concatenate([[first - 1], t_ns, [last + 1]])
    after = np.searchsorted(edges, alone.t_ns, side="right")
    hole_s = (edges[after] - edges[after - 1]) * 1e-9
    # where a reading is there is a row already
    return alone.at(np.flatnonzero((hole_s > LONGEST_GAP_S) & (edges[after - 1] < alone.t_ns)))


def joined(stretches: Iterable[Trajectory], more: Trajectory) -> Iterator[Trajectory]:
    """The ``stretches`` of a trajectory with the rows of another, of other stamps, among them."""
    done = 0
    for stretch in stretches:
        reached = int(np.searchsorted(more.t_ns, stretch.t_ns[-1]))
        both = whole_trajectory([stretch, more.at(slice(done, reached))])
        yield both.at(np.argsort(both.t_ns, kind="stable")) if reached > done else stretch
        done = reached
    if done < len(more):
        yield more.at(slice(done, None))


def driven_m(path: Trajectory) -> float:
    """Metres driven between the rows of a path that are near enough for poses between them."""
    step, speed = np.diff(path.gps_s), np.hypot(path.vel_ned[1:, 0], path.vel_ned[1:, 1])
    return float((step * speed)[(step <= LONGEST_GAP_S) & (speed > DRIVING_SPEED)].sum())


def later(reasons: Sequence[Reason], seconds: float) -> list[Reason]:
    """The reasons, whose stretches count from ``seconds`` earlier on."""
    return [
        replace(one, spans=tuple((a + seconds, b + seconds) for a, b in one.spans))
        for one in reasons
    ]
