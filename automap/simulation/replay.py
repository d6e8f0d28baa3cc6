"""Recorded errors of a receiver along another drive."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from automap.effects import CATALOGUE
from automap.effects.measured import Values
from automap.errors import ConfigError
from automap.records import BoolArray, FixErrors, FixType, FloatArray
from automap.simulation.receiver_errors import ReceiverErrors, last_good
from automap.simulation.scenario import Replay

_GAP = 2.5
"""Epochs so many usual steps apart have lost ones between them: more than one, whatever the
jitter of the tags."""


@dataclass(frozen=True)
class Replayed:
    """Recorded errors at the epochs of a drive: ``position`` [n, 3] m NED, ``velocity`` [n, 3] m/s
    along, across and down (NaN unknown), ``lost`` [n] where the recording has no fix; from
    ``start_s`` s of it on, begun anew at ``seams_s`` s of the drive."""

    position: FloatArray
    velocity: FloatArray
    lost: BoolArray
    start_s: float
    seams_s: tuple[float, ...]


def replay(
    recorded: FixErrors, t_s: FloatArray, setup: Replay, rng: np.random.Generator
) -> Replayed:
    """The errors at epochs ``t_s`` [n], linear between those recorded.

    Raises:
        ConfigError: a series shorter than the drive that may not begin anew, or a start beyond it.
    """
    times = recorded.gps_s - recorded.gps_s[0]
    span, length = float(times[-1]), float(t_s[-1] - t_s[0])
    if not setup.wrap and length + (setup.start_s or 0.0) > span:
        raise ConfigError(
            f"gnss.replay: {setup.errors} has errors of {span:.0f} s, the drive takes {length:.0f} "
            f"s from {setup.start_s or 0.0:.0f} s on; take a shorter drive, or set wrap = true, "
            "which begins them anew where they end"
        )
    if setup.start_s is not None and setup.start_s > span:
        raise ConfigError(f"gnss.replay.start_s lies behind the {span:.0f} s of {setup.errors}")
    free = span if setup.wrap else span - length
    start = float(rng.uniform(0.0, free)) if setup.start_s is None else setup.start_s
    along = start + t_s - t_s[0]
    at = along % span if setup.wrap else along
    seams = t_s[0] + span * np.arange(1.0, along[-1] // span + 1.0) - start
    steps = np.diff(times)
    after = np.clip(np.searchsorted(times, at, side="right"), 1, len(times) - 1)
    usual = float(np.median(steps))
    away = np.minimum(at - times[after - 1], times[after] - at)
    lost = (steps[after - 1] > _GAP * usual) & (away > 0.5 * usual)
    columns = np.column_stack([recorded.position, recorded.velocity]).T
    values = np.stack([np.interp(at, times, column) for column in columns], axis=1)
    return Replayed(values[:, :3], values[:, 3:], lost, start, tuple(seams.tolist()))


def in_place(drawn: ReceiverErrors, replayed: Replayed, heading: FloatArray) -> ReceiverErrors:
    """Recorded errors in place of drawn ones, which stay where the recording says nothing;
    ``heading`` [n] rad is the direction along which velocities err."""
    along, across, down = replayed.velocity.T
    c, s = np.cos(heading), np.sin(heading)
    velocity = np.stack([c * along - s * across, s * along + c * across, down], axis=1)
    lost = replayed.lost | (drawn.fix_type == FixType.NONE)
    return replace(
        drawn,
        position=np.where(np.isfinite(replayed.position), replayed.position, drawn.position),
        velocity=np.where(np.isfinite(velocity), velocity, drawn.velocity),
        position_of=last_good(~lost),
        velocity_of=last_good(~lost),
        fix_type=np.where(lost, FixType.NONE, drawn.fix_type).astype(np.int64),
    )


def other_errors(values: Values, recorded: FixErrors) -> Values:
    """The effects that act beside recorded errors: no random ones of the receiver, and the
    recorded delays in place of the scenario's."""
    out = {
        name: given
        for name, given in values.items()
        if CATALOGUE[name].family != "gnss" or CATALOGUE[name].of_recorder
    }
    out.pop("gnss_velocity_lag", None)
    out["gnss_velocity_latency"] = {"s": recorded.speed_delay_s}
    out["gnss_course_latency"] = {"s": recorded.course_delay_s - recorded.speed_delay_s}
    return out
