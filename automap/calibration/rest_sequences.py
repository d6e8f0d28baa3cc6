"""The paper's figure 2: roll and pitch of a resting sensor, sequence by sequence.

Each sequence is a rest in which the gyro's bias is not the one it was calibrated with: another
turn-on, or another hour. Without dynamic calibration roll and pitch run away, each sequence
differently; with it, the running filter of the pseudo-velocity, they stay put.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from automap.calibration.dynamic import calibrate_dynamic
from automap.calibration.limits import STILL_LIMIT, TURN_ON_SD
from automap.calibration.rest import Rest, movement, rests_below
from automap.calibration.rest_attitude import (
    largest_turn,
    rest_attitude,
    roll_pitch_since_start,
)
from automap.earth import STANDARD_GRAVITY
from automap.errors import InputError
from automap.frames import quat_to_matrix, rpy_to_matrix
from automap.records import FloatArray, RawImu

SEQUENCES, SHORTEST_S = 10, 5.0
"""So many rests of at least this length are drawn."""
SIMULATED_S, _RATE_HZ = 50.0, 100.0
"""The paper's sequences, as they are simulated."""
_TURN_ON = (np.radians(0.15), 0.05)
"""One sigma of a simulated turn-on: gyro rad/s, accelerometer m/s^2; of consumer sensors."""
_NOISE = (np.radians(0.01), 0.002)
"""Simulated noise, rad/s/sqrt(Hz) and m/s^2/sqrt(Hz)."""


@dataclass(frozen=True)
class RestSequence:
    """One rest: roll and pitch [n, 2] in rad since its start, without and with dynamic
    calibration.

    ``t_s`` [n] from its start and ``t_with_s`` of the second. The drifts, rad, are the largest
    angles by which gravity's direction in body axes leaves that of the start; ``drift_constant``
    is what is left when the filter's last biases are applied to the whole rest: mostly the
    gyro's own noise, integrated. ``drift_mean`` is that with the rest's own mean rate taken
    out, about the best that any constant bias can do.
    """

    start_s: float
    seconds: float
    t_s: FloatArray
    without: FloatArray
    t_with_s: FloatArray
    with_it: FloatArray
    drift_without: float
    drift_with: float
    drift_constant: float
    drift_mean: float


def log_sequences(log: RawImu, bias_at_s: float | None = None) -> tuple[list[RestSequence], float]:
    """The longest rests of a log, with the gyro bias of one rest applied to all others.

    ``log`` in known units; ``bias_at_s`` is when to take the bias, None for the last rest.
    Returns the sequences in order of time, and the middle of the rest that gave the bias.

    Raises:
        InputError: units unknown, or fewer than two rests of five seconds.
    """
    if log.gyro_scale is None or log.accel_scale is None:
        raise InputError(
            f"{log.name} is in counts; write it in units with `automap calibrate static --apply` "
            "and take that."
        )
    found = rests_below([log], [movement(log)], STILL_LIMIT)
    rests = [rest for rest in found if rest.length_s >= SHORTEST_S]
    if len(rests) < 2:
        raise InputError(
            f"{log.name}: {len(rests)} rest{'s' * (len(rests) != 1)} of {SHORTEST_S:.0f} s or "
            "more; two are needed, one for the bias and one to see it drift."
        )
    source = rests[-1]
    if bias_at_s is not None:
        source = min(rests, key=lambda rest: abs(rest.middle_s - bias_at_s))
    others = sorted((r for r in rests if r is not source), key=lambda r: -r.length_s)
    chosen = sorted(others[:SEQUENCES], key=lambda r: r.start)
    bias = source.gyro * log.gyro_scale
    return [_of_rest(log, rest, bias) for rest in chosen], source.middle_s


def _of_rest(log: RawImu, rest: Rest, bias: FloatArray) -> RestSequence:
    rows = slice(rest.start, rest.stop)
    part = replace(
        log, t_ns=log.t_ns[rows], gyro=log.gyro[rows], accel=log.accel[rows], temp_c=None
    )
    assert log.gyro_scale is not None
    assert log.accel_scale is not None
    sequence = sequence_of(part, part.gyro * log.gyro_scale - bias, part.accel * log.accel_scale)
    return replace(sequence, start_s=float(log.t_s[rest.start]))


def sequence_of(log: RawImu, gyro: FloatArray, accel: FloatArray) -> RestSequence:
    """One resting log with its conditioned readings [n, 3] in rad/s and m/s^2."""
    # the length of gravity is not in question here
    gravity = float(np.linalg.norm(accel.mean(axis=0)))
    found = calibrate_dynamic(log, gyro, accel, gravity, TURN_ON_SD, least_s=0.8 * SHORTEST_S)
    e = found.final
    t_s = log.t_s
    without = rest_attitude(t_s, gyro, accel)
    constant = rest_attitude(t_s, (1.0 + e[9:]) * gyro + e[3:6], accel)
    mean = rest_attitude(t_s, gyro - gyro.mean(axis=0), accel)
    some = np.unique(np.linspace(0, len(t_s) - 1, 500).astype(np.int64))
    down = quat_to_matrix(found.quat[some])[:, 2, :]
    return RestSequence(
        start_s=0.0,
        seconds=float(t_s[-1]),
        t_s=without.t_s,
        without=roll_pitch_since_start(without.down),
        t_with_s=t_s[some],
        with_it=roll_pitch_since_start(down),
        drift_without=without.drift,
        drift_with=largest_turn(down),
        drift_constant=constant.drift,
        drift_mean=mean.drift,
    )


def simulated_sequences(seeds: Sequence[int] = range(SEQUENCES)) -> list[RestSequence]:
    """Rests of a simulated sensor, each in a tilt and with a turn-on of its own."""
    return [_simulated(seed) for seed in seeds]


def _simulated(seed: int) -> RestSequence:
    rng = np.random.default_rng(seed)
    n = round(SIMULATED_S * _RATE_HZ)
    tilt = np.radians(np.concatenate([rng.uniform(-30.0, 30.0, 2), [0.0]]))
    force = rpy_to_matrix(tilt).T @ np.array([0.0, 0.0, -STANDARD_GRAVITY])
    root = np.sqrt(_RATE_HZ)
    gyro = rng.normal(0.0, _TURN_ON[0], 3) + rng.normal(0.0, _NOISE[0] * root, (n, 3))
    accel = force + rng.normal(0.0, _TURN_ON[1], 3) + rng.normal(0.0, _NOISE[1] * root, (n, 3))
    log = RawImu(
        t_ns=np.arange(n, dtype=np.int64) * round(1e9 / _RATE_HZ),
        gyro=gyro,
        accel=accel,
        gyro_scale=np.ones(3),
        accel_scale=np.ones(3),
        name="simulated",
    )
    return sequence_of(log, gyro, accel)
