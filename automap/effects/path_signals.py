"""The quantities of a drive along a known path: what users' effects of a camera depend on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from automap.earth import gravity
from automap.effects.signals import Signals, signals_of
from automap.frames import matrix_to_rotation_vector, rpy_to_matrix
from automap.records import FloatArray, ImuData, IntArray, Trajectory


@dataclass(frozen=True)
class PathSignals:
    """Quantities of a drive since its first row at ``start_ns``."""

    start_ns: int
    signals: Signals

    def at(self, t_ns: IntArray) -> Signals:
        """The quantities at stamps [n]."""
        seconds = (np.asarray(t_ns, np.int64) - self.start_ns) * 1e-9
        return self.signals.at(np.asarray(seconds, np.float64))


def path_signals(trajectory: Trajectory, imu: ImuData | None = None) -> PathSignals:
    """The quantities along a trajectory of at least two rows; the temperature is the ``imu``'s."""
    time = np.asarray((trajectory.t_ns - trajectory.t_ns[0]) * 1e-9)
    vel = np.nan_to_num(trajectory.vel_ned)
    C = rpy_to_matrix(np.nan_to_num(trajectory.rpy))
    turned = matrix_to_rotation_vector(np.swapaxes(C[:-1], 1, 2) @ C[1:])
    rate = turned / np.maximum(np.diff(time), 1e-9)[:, None]
    accel = np.gradient(vel, time, axis=0)
    down = gravity(np.nan_to_num(trajectory.lat_rad), np.nan_to_num(trajectory.height_m))
    level = np.column_stack([np.zeros((len(time), 2)), down])
    temp_c: FloatArray | None = None
    if imu is not None and imu.temp_c is not None:
        temp_c = np.interp(time, (imu.t_ns - trajectory.t_ns[0]) * 1e-9, imu.temp_c)
    signals = signals_of(
        *(time, vel, np.unwrap(np.nan_to_num(trajectory.rpy[:, 2]))),
        np.einsum("ni,ni->n", C[:, :, 0], accel),
        np.concatenate([rate, rate[-1:]]),
        np.einsum("nji,nj->ni", C, accel - level),
        temp_c,
    )
    return PathSignals(int(trajectory.t_ns[0]), signals)
