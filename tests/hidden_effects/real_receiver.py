"""Errors of real receivers, taken from recordings with a reference, along other drives.

A phone's fixes err in three ways that are kept apart here, since on another road each acts
otherwise: what is told is of an instant before or after the tag (positions, speeds and courses
each by their own delay), what stands still is told as such, and the rest is a series of errors.
On a simulated drive the delays act on that drive's motion and the series is laid over it from a
random instant on, forwards or backwards in time, turned to a random direction, either side out.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from datetime import datetime
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tests.hidden_effects.geodesy import Array, meridian_radius, normal_radius
from tests.hidden_effects.noise import GnssNoise

Booleans = npt.NDArray[np.bool_]
RECORDINGS = ("gsdc-mtv1", "gsdc-mtv1-xl")
"""Half an hour each with a reference of decimetres. Of the other shared recordings the KITTI fixes
are drawn, comma2k19's minute is shorter than a drive, and the rest has no reference."""
GPS_EPOCH = datetime(1980, 1, 6)
LEAP_S = 18.0
KNOT = 1852.0 / 3600.0
MOVES = 3.0  # m/s, from where on a course says something
DELAYS_S = np.arange(-0.4, 1.5, 0.01)


def shared_drives() -> Path | None:
    """The folder of recorded drives, None where this computer has none."""
    root = os.environ.get("AUTOMAP_SHARED_DATA", "")
    folder = Path(root) / "drives"
    return folder if root and all((folder / n).is_dir() for n in RECORDINGS) else None


@dataclass(frozen=True)
class Series:
    """One receiver's errors at instants ``t`` [n] s from the first fix on.

    ``position`` [n, 3] m, north, east, down, against the place ``position_s`` before the tag;
    ``along``, ``across`` [n] m/s: speed against that ``speed_s`` before, and course, as a
    velocity across it, against that ``course_s`` before; ``hdop`` [n] as stated. Below ``rest``
    m/s it says that it stands.
    """

    name: str
    t: Array
    position: Array
    along: Array
    across: Array
    hdop: Array
    position_s: float
    speed_s: float
    course_s: float
    rest: float

    def noise(self) -> GnssNoise:
        """White and wandering noise of the same evidence for what lasts: velocity errors with
        memory count as white ones of the same sum of autocovariances.

        On the safe side: over ten stretches of five minutes, delays known, the scores of eight
        errors scattered with 0.2 (velocity lag) to 0.9 (accelerometer misalignment) of the sigma
        that this noise gives them.
        """
        slow = self.position[:, :2]
        step = float(np.std(np.diff(slow, axis=0)) / np.sqrt(2.0))
        lasting = max(_long_run_sd(self.along), _long_run_sd(self.across))
        return GnssNoise(
            white=step,
            wander=float(np.std(slow)),
            wander_s=60.0,
            velocity=lasting,
            vertical=float(np.std(self.position[:, 2]) / np.std(slow)),
            rate_hz=1.0,
            down_known=False,
        )


def _long_run_sd(error: Array) -> float:
    """Square root of the sum of autocovariances of ``error`` [n] up to ten epochs; each epoch's
    own spread at least."""
    e = error - error.mean()
    cov = [float(np.mean(e[k:] * e[: len(e) - k])) for k in range(11)]
    return float(np.sqrt(max(cov[0] + 2.0 * sum(cov[1:]), cov[0])))


@cache
def read_series(name: str) -> Series:
    """The errors of a recording of RECORDINGS.

    Raises:
        FileNotFoundError: no shared drives on this computer.
    """
    root = shared_drives()
    if root is None:
        raise FileNotFoundError("AUTOMAP_SHARED_DATA holds no drives with a reference")
    truth = np.genfromtxt(root / name / "truth" / "trajectory.csv", delimiter=",", names=True)
    fixes = _nmea(root / name / "gnss.nmea")
    tag, lat, lon, height, speed, course, hdop = fixes.T
    then, vn, ve = truth["gps_s"], truth["vn"], truth["ve"]
    true_speed = np.hypot(vn, ve)
    moving = np.interp(tag, then, true_speed) > MOVES
    # a heading that holds on while the car stands
    heading = np.unwrap(np.arctan2(ve, vn))
    psi = np.interp(tag, then, heading)
    lat0, lon0 = (np.radians(np.interp(tag, then, truth[k])) for k in ("lat_deg", "lon_deg"))
    h0 = np.interp(tag, then, truth["height_m"])
    error = np.column_stack(
        [
            (np.radians(lat) - lat0) * (meridian_radius(lat0) + h0),
            (np.radians(lon) - lon0) * (normal_radius(lat0) + h0) * np.cos(lat0),
            h0 - height,
        ]
    )
    now = np.interp(tag, then, true_speed)
    body = np.column_stack(
        [
            np.cos(psi) * error[:, 0] + np.sin(psi) * error[:, 1],
            -np.sin(psi) * error[:, 0] + np.cos(psi) * error[:, 1],
        ]
    )
    # what is fixed in the car is where the phone lies, no error of its receiver
    A = np.column_stack([-now[moving], np.ones(int(moving.sum()))])
    position_s, ahead = np.linalg.lstsq(A, body[moving, 0], rcond=None)[0]
    along = body[:, 0] + position_s * now - ahead
    across = body[:, 1] - body[moving, 1].mean()
    position = np.column_stack(
        [
            np.cos(psi) * along - np.sin(psi) * across,
            np.sin(psi) * along + np.cos(psi) * across,
            error[:, 2] - error[:, 2].mean(),
        ]
    )
    told_rest = speed == 0.0
    speeds = [speed - np.interp(tag - d, then, true_speed) for d in DELAYS_S]
    turns = [_wrapped(np.radians(course) - np.interp(tag - d, then, heading)) for d in DELAYS_S]
    best = int(np.argmin([np.std(e[moving]) for e in speeds]))
    # 0.5 m/s across is no error of the course's age
    turned = int(np.argmin([np.mean(np.minimum((e * now)[moving] ** 2, 0.25)) for e in turns]))
    drives = ~told_rest
    return Series(
        name=name,
        t=tag - tag[0],
        position=position,
        along=_carried(tag, speeds[best], drives),
        across=_carried(tag, turns[turned] * now, drives & moving),
        hdop=hdop,
        position_s=float(position_s),
        speed_s=float(DELAYS_S[best]),
        course_s=float(DELAYS_S[turned]),
        rest=float(np.min(speed[drives])),
    )


def _carried(tag: Array, error: Array, valid: Booleans) -> Array:
    """Errors at all tags: between valid ones linear."""
    return np.interp(tag, tag[valid], error[valid])


def _wrapped(angle: Array) -> Array:
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def _nmea(path: Path) -> Array:
    """GPS time s, latitude and longitude deg, height m, speed m/s, course deg, HDOP of each epoch
    with both sentences."""
    places: dict[str, list[float]] = {}
    rows = []
    for line in path.read_text(encoding="ascii").splitlines():
        f = line.split("*")[0].split(",")
        if f[0] == "$GPGGA" and f[2]:
            lat, lon = _degrees(f[2], f[3]), _degrees(f[4], f[5])
            places[f[1]] = [lat, lon, float(f[9]) + float(f[11]), float(f[8])]
        elif f[0] == "$GPRMC" and f[2] == "A" and f[1] in places:
            lat, lon, height, hdop = places[f[1]]
            when = datetime.strptime(f[9] + f[1][:6], "%d%m%y%H%M%S")
            gps = (when - GPS_EPOCH).total_seconds() + float("0." + f[1][7:]) + LEAP_S
            rows.append([gps, lat, lon, height, float(f[7]) * KNOT, float(f[8]), hdop])
    return np.array(rows)


def _degrees(text: str, side: str) -> float:
    whole = text.index(".") - 2
    value = float(text[:whole]) + float(text[whole:]) / 60.0
    return -value if side in "SW" else value


@dataclass(frozen=True)
class Replay:
    """A stretch of a series on a drive: ``start`` s of it, ``backwards`` in time, ``turn`` rad
    clockwise, ``mirror`` and ``upside`` -1 or 1 for the side and for height, ``sign`` of the
    velocity's errors."""

    recording: str
    start: float
    backwards: bool
    turn: float
    mirror: float
    upside: float
    sign: float

    def series(self) -> Series:
        """The recorded errors."""
        return read_series(self.recording)

    def tags(self, seconds: float) -> Array:
        """Times of the fixes on a drive of ``seconds``: as recorded, lost ones lost."""
        rows, tag = self._rows(seconds)
        return tag[np.argsort(tag)] if len(rows) else tag

    def _rows(self, seconds: float) -> tuple[npt.NDArray[np.int64], Array]:
        t = self.series().t
        end = self.start + seconds
        rows = np.flatnonzero((t >= self.start + 1.0) & (t <= end - 1.0))
        tag = np.rint(end - t[rows]) if self.backwards else np.rint(t[rows] - self.start)
        return rows, np.asarray(tag, np.float64)

    def errors(self, seconds: float) -> tuple[Array, Array, Array, Array]:
        """Position [n, 3] m NED, along [n], across [n] m/s and HDOP [n] at ``tags``."""
        rows, tag = self._rows(seconds)
        rows = rows[np.argsort(tag)]
        series = self.series()
        north, east = series.position[rows, 0], self.mirror * series.position[rows, 1]
        c, s = np.cos(self.turn), np.sin(self.turn)
        down = self.upside * series.position[rows, 2]
        position = np.column_stack([c * north - s * east, s * north + c * east, down])
        across = self.mirror * series.across[rows]
        return position, self.sign * series.along[rows], across, series.hdop[rows]


def draw_replay(rng: np.random.Generator, seconds: float, recording: str = "") -> Replay:
    """A random stretch for a drive of ``seconds``, of a ``recording`` or of any."""
    name = recording or str(rng.choice(RECORDINGS))
    span = float(read_series(name).t[-1])
    return Replay(
        recording=name,
        start=float(np.floor(rng.uniform(0.0, span - seconds))),
        backwards=bool(rng.random() < 0.5),
        turn=float(rng.uniform(-np.pi, np.pi)),
        mirror=float(rng.choice([-1.0, 1.0])),
        upside=float(rng.choice([-1.0, 1.0])),
        sign=float(rng.choice([-1.0, 1.0])),
    )
