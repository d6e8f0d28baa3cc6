"""A trajectory as some thirty epochs with their sigmas, and how far a later one is from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from automap.earth import metres_per_radian
from automap.evaluation.trajectory_errors import position_difference_ned
from automap.frames import wrap_pi
from automap.interpolation import poses_at
from automap.records import FloatArray, IntArray, Trajectory
from automap.regression.change import Change, Tolerance
from automap.regression.limits import EPOCHS_FLOOR

EPOCHS = 32
"""Chosen: every part of a drive is among them, and the stored file stays small."""
_NAMES = ("north", "east", "down", "v north", "v east", "v down", "roll", "pitch", "yaw")
_UNITS = ("m", "m", "m", "m/s", "m/s", "m/s", "deg", "deg", "deg")
_SHOWN = np.array([1.0] * 6 + [np.degrees(1.0)] * 3)
_STEP = np.array([1e-4] * 3 + [1e-4] * 3 + [1e-6] * 3)
"""Resolution of the stored numbers (m, m/s, rad)."""
_MOST_STEPS = 1e12
"""Of that resolution: round the Earth it is half of it."""


@dataclass(frozen=True)
class Epochs:
    """Poses at stamps ``t_ns`` [n]: ``lat_rad``, ``lon_rad``, ``height_m`` [n], ``vel_ned``,
    ``rpy`` [n, 3] and the sigmas ``sd`` [n, 9] of position, velocity, attitude (m, m/s, rad)."""

    t_ns: IntArray
    lat_rad: FloatArray
    lon_rad: FloatArray
    height_m: FloatArray
    vel_ned: FloatArray
    rpy: FloatArray
    sd: FloatArray

    def __len__(self) -> int:
        return len(self.t_ns)


def sample(trajectory: Trajectory, count: int = EPOCHS) -> Epochs:
    """Rows of the trajectory evenly spread over its time, the ends among them."""
    known = np.flatnonzero(np.isfinite(trajectory.lat_rad) & np.isfinite(trajectory.lon_rad))
    if len(known) == 0:
        rows = known
    else:
        t_ns = trajectory.t_ns[known]
        wanted = t_ns[0] + np.rint(np.linspace(0.0, float(t_ns[-1] - t_ns[0]), count)).astype(
            np.int64
        )
        rows = np.unique(known[np.minimum(np.searchsorted(t_ns, wanted), len(known) - 1)])
    return Epochs(
        t_ns=trajectory.t_ns[rows],
        lat_rad=trajectory.lat_rad[rows],
        lon_rad=trajectory.lon_rad[rows],
        height_m=trajectory.height_m[rows],
        vel_ned=trajectory.vel_ned[rows],
        rpy=trajectory.rpy[rows],
        sd=np.column_stack(
            [trajectory.sd_pos_ned[rows], trajectory.sd_vel_ned[rows], trajectory.sd_rpy[rows]]
        ),
    )


def compare(stored: Epochs, trajectory: Trajectory | None, allowed: Tolerance) -> list[Change]:
    """How far ``trajectory`` lies from the stored epochs, a figure for each component."""
    if len(stored) == 0 and (trajectory is None or len(trajectory) == 0):
        return []
    if trajectory is None or len(stored) == 0:
        pair = ("none", "there") if len(stored) == 0 else ("there", "none")
        return [Change("trajectory", "trajectory", *pair, moved=True)]
    poses = poses_at(trajectory, stored.t_ns)
    covered = poses.covered
    lost = int(np.count_nonzero(~covered))
    changes = [
        Change(
            "trajectory",
            "epochs covered",
            str(len(stored)),
            str(len(stored) - lost),
            moved=lost > 0,
            size=f"{lost} lost" if lost else "",
        )
    ]
    if not covered.any():
        return changes
    difference = np.column_stack(
        [
            position_difference_ned(
                poses.lat_rad,
                poses.lon_rad,
                poses.height_m,
                stored.lat_rad,
                stored.lon_rad,
                stored.height_m,
            ),
            poses.vel_ned - stored.vel_ned,
            np.asarray(wrap_pi(poses.rpy - stored.rpy)),
        ]
    )
    seconds = (stored.t_ns - stored.t_ns[0]) * 1e-9
    for column, (name, unit) in enumerate(zip(_NAMES, _UNITS, strict=True)):
        # what neither run knows (a trajectory without attitude, say) cannot have moved
        told = covered & np.isfinite(stored.sd[:, column])
        if told.any():
            scale = np.maximum(stored.sd[told, column], EPOCHS_FLOOR[column])
            now = difference[told, column]
            changes.append(_component(name, unit, column, now, scale, seconds[told], allowed))
    now_sd = np.column_stack([poses.sd_pos_ned, poses.sd_vel_ned, poses.sd_rpy])
    for first, name in ((0, "position"), (3, "velocity"), (6, "attitude")):
        block = slice(first, first + 3)
        change = _spread(name, stored.sd[:, block], now_sd[:, block], first, allowed)
        if change is not None:
            changes.append(change)
    return changes


def _component(
    name: str,
    unit: str,
    column: int,
    difference: FloatArray,
    scale: FloatArray,
    seconds: FloatArray,
    allowed: Tolerance,
) -> Change:
    """One component: its rms over the epochs, or the worst epoch where that is what moved."""
    gone = int(np.count_nonzero(~np.isfinite(difference)))
    if gone:
        return Change("trajectory", name, "known", f"unknown at {gone} epochs", moved=True)
    ratio = np.abs(difference) / scale
    rms, worst = float(np.sqrt(np.mean(ratio**2))), int(np.argmax(ratio))
    rms_unit = float(np.sqrt(np.mean(difference**2))) * _SHOWN[column]
    if rms <= allowed.mean and ratio[worst] > allowed.worst:
        size = abs(float(difference[worst])) * _SHOWN[column]
        return Change(
            "trajectory",
            f"{name}, worst epoch",
            f"at {seconds[worst]:.1f} s",
            f"{size:.3g} {unit} off",
            moved=True,
            sigmas=float(ratio[worst]),
            allowed=allowed.worst,
        )
    return Change(
        "trajectory",
        name,
        f"± {float(np.median(scale)) * _SHOWN[column]:.3g} {unit}",
        f"{rms_unit:.3g} {unit} off",
        moved=rms > allowed.mean,
        sigmas=rms,
        allowed=allowed.mean,
    )


def _spread(
    name: str, then: FloatArray, now: FloatArray, column: int, allowed: Tolerance
) -> Change | None:
    """The stated sigmas of a block of three components, by the median of their ratio."""
    good = (then > 0.0) & (now > 0.0)
    if not good.any():
        return None
    factor = float(np.exp(np.median(np.log(now[good] / then[good]))))
    floor = EPOCHS_FLOOR[column]
    small = bool(np.median(np.maximum(then[good], now[good])) < floor)
    scale = _SHOWN[column]
    unit = _UNITS[column]
    return Change(
        "trajectory",
        f"stated sigma of {name}",
        f"{float(np.median(then[good])) * scale:.3g} {unit}",
        f"{float(np.median(now[good])) * scale:.3g} {unit}",
        moved=not small and max(factor, 1.0 / factor) > allowed.spread,
        size=f"x {factor:.2f}" if round(factor, 2) != 1.0 else "",
    )


def to_json(epochs: Epochs) -> dict[str, Any]:
    """The epochs as small integers and short numbers: some 3 kB for thirty of them."""
    if len(epochs) == 0:
        return {}
    lat0, lon0 = float(epochs.lat_rad[0]), float(epochs.lon_rad[0])
    north, east = (float(v) for v in metres_per_radian(epochs.lat_rad[0], 0.0))
    values = np.column_stack(
        [
            (epochs.lat_rad - lat0) * north,
            np.asarray(wrap_pi(epochs.lon_rad - lon0)) * east,
            -epochs.height_m,
            epochs.vel_ned,
            epochs.rpy,
        ]
    )
    return {
        "t0_ns": int(epochs.t_ns[0]),
        "t_ns": (epochs.t_ns - epochs.t_ns[0]).tolist(),
        "origin_rad": [lat0, lon0],
        "m_per_rad": [north, east],
        "step": _STEP.tolist(),
        "value": [
            [None if not np.isfinite(v) else round(v) for v in column.tolist()]
            for column in (values / _STEP).T
        ],
        "sd": [
            [None if not np.isfinite(v) else float(f"{v:.3g}") for v in column.tolist()]
            for column in epochs.sd.T
        ],
    }


def from_json(stored: dict[str, Any]) -> Epochs:
    """What ``to_json`` wrote; raises KeyError, TypeError or ValueError for anything else."""
    if stored == {}:
        nothing, three = np.zeros(0), np.zeros((0, 3))
        return Epochs(
            np.zeros(0, np.int64), nothing, nothing, nothing, three, three, np.zeros((0, 9))
        )
    try:
        t_ns = np.array([int(stored["t0_ns"]) + t for t in stored["t_ns"]], np.int64)
    except OverflowError as error:
        raise ValueError("a time of the trajectory is beyond 64 bits") from error
    value = np.array(stored["value"], np.float64).T
    step = np.array(stored["step"], np.float64)
    if np.any(np.abs(value) > _MOST_STEPS) or not np.all((step > 0.0) & (step < 1.0)):
        raise ValueError("the trajectory holds numbers that no drive has")
    value = value * step
    sd = np.array(stored["sd"], np.float64).T
    if value.shape != (len(t_ns), 9) or sd.shape != (len(t_ns), 9):
        raise ValueError("the epochs of the trajectory have columns of different lengths")
    lat0, lon0 = (float(v) for v in stored["origin_rad"])
    north, east = (float(v) for v in stored["m_per_rad"])
    if not (north > 1.0 and east > 1e-9):
        raise ValueError("the trajectory does not say where on Earth it is")
    return Epochs(
        t_ns=t_ns,
        lat_rad=lat0 + value[:, 0] / north,
        lon_rad=np.asarray(wrap_pi(lon0 + value[:, 1] / east)),
        height_m=-value[:, 2],
        vel_ned=value[:, 3:6],
        rpy=value[:, 6:9],
        sd=sd,
    )
