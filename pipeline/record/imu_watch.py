"""What the inertial sensor's samples say of themselves while they are recorded."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from automap.earth import STANDARD_GRAVITY
from automap.io.sensor_file import SensorModel, find_sensor, read_sensor
from automap.records import FloatArray
from pipeline.record.imu_format import ImuFormat

_WINDOW_S = 5.0
_LONG_S = 10.0
_SETTLE_S = 12.0


@dataclass(frozen=True)
class ImuState:
    """The sensor as seen now; NaN where unknown.

    ``gravity`` m/s^2 is the mean length of the specific force over the last ten seconds,
    ``accel`` m/s^2 and ``gyro`` rad/s the last readings [3] in SI units; ``clock_skew`` that
    of the device's clock.
    """

    samples: int = 0
    bad: int = 0
    rate_hz: float = 0.0
    usual_hz: float = float("nan")
    gaps: int = 0
    longest_gap_s: float = 0.0
    gravity: float = float("nan")
    accel: tuple[float, ...] = ()
    gyro: tuple[float, ...] = ()
    temp_c: float = float("nan")
    clock_skew: float = 0.0
    clock_resets: int = 0


class ImuWatch:
    """Follows rate, gaps, gravity and dead axes."""

    def __init__(self, form: ImuFormat) -> None:
        self.state = ImuState(usual_hz=form.rate_hz or float("nan"))
        self._form = form
        self._sensor: SensorModel | None = None
        if form.sensor and "counts" in (form.gyro_unit, form.accel_unit):
            self._sensor = read_sensor(find_sensor(form.sensor))
        # seconds of samples: time, count, sum of lengths, least and greatest reading [6]
        self._batches: deque[tuple[int, int, float, FloatArray, FloatArray]] = deque()
        self._last_ns: int | None = None
        self._first_ns: int | None = None
        self._bad: deque[tuple[int, int]] = deque()
        self._steps: deque[float] = deque(maxlen=200)

    def take(self, t_ns: list[int], values: list[tuple[float | int, ...]], bad: int) -> None:
        """Samples [n] with their stamps; ``bad`` is the count of spoiled ones since the start."""
        state = self.state
        if bad != state.bad and t_ns:
            self._bad.append((t_ns[-1], bad - state.bad))
        if not t_ns:
            self.state = replace(state, bad=bad)
            return
        stamps = np.asarray(t_ns, dtype=np.int64)
        readings = np.asarray(values, dtype=np.float64)
        gyro, accel = self._to_si(readings[:, 0:3], readings[:, 3:6])
        gaps, longest = state.gaps, state.longest_gap_s
        if self._last_ns is None:
            self._first_ns = t_ns[0]
            steps = np.diff(stamps) * 1e-9
        else:
            steps = np.diff(stamps, prepend=self._last_ns) * 1e-9
        self._steps.extend(steps.tolist())
        usual = float(np.median(self._steps)) if len(self._steps) >= 20 else float("inf")
        wide = steps[steps > max(2.5 * usual, usual + 0.01)]
        if len(wide):
            gaps, longest = gaps + len(wide), max(longest, float(wide.max()))
        self._last_ns = t_ns[-1]
        lengths = np.sqrt(np.einsum("ij,ij->i", accel, accel))
        both = np.concatenate([gyro, accel], axis=1)
        batch = (t_ns[-1], len(t_ns), float(lengths.sum()), both.min(axis=0), both.max(axis=0))
        self._batches.append(batch)
        while t_ns[-1] - self._batches[0][0] > _LONG_S * 1e9:
            self._batches.popleft()
        count = sum(b[1] for b in self._batches)
        self.state = replace(
            state,
            samples=state.samples + len(t_ns),
            bad=bad,
            gaps=gaps,
            longest_gap_s=longest,
            gravity=sum(b[2] for b in self._batches) / count,
            accel=tuple(accel[-1].tolist()),
            gyro=tuple(gyro[-1].tolist()),
            temp_c=float(readings[-1, 6]) if readings.shape[1] > 6 else state.temp_c,
        )

    def _to_si(self, gyro: FloatArray, accel: FloatArray) -> tuple[FloatArray, FloatArray]:
        form, sensor = self._form, self._sensor
        if form.gyro_unit == "counts" and sensor is not None:
            gyro = sensor.gyro.from_counts(gyro)
        elif form.gyro_unit == "deg/s":
            gyro = np.radians(gyro)
        if form.accel_unit == "counts" and sensor is not None:
            accel = sensor.accel.from_counts(accel)
        elif form.accel_unit == "g":
            accel = accel * STANDARD_GRAVITY
        return gyro, accel

    def update(self, now_ns: int, skew: float, resets: int) -> ImuState:
        """The state with its rate as of now."""
        recent = [b for b in self._batches if now_ns - b[0] <= _WINDOW_S * 1e9]
        count = sum(b[1] for b in recent)
        rate = 0.0
        if len(recent) > 1:
            span_s = (recent[-1][0] - recent[0][0]) * 1e-9
            rate = (count - recent[0][1]) / max(span_s, 1e-3)
        usual = self.state.usual_hz
        settled = self._first_ns is not None and now_ns - self._first_ns > _SETTLE_S * 1e9
        if not np.isfinite(usual) and settled and rate > 0:
            usual = rate
        self.state = replace(
            self.state, rate_hz=rate, usual_hz=usual, clock_skew=skew, clock_resets=resets
        )
        return self.state

    def conditions(self, now_ns: int, started_ns: int, last_byte_ns: int | None) -> dict[str, str]:
        """What is wrong now."""
        found: dict[str, str] = {}
        state = self.state
        if now_ns - (last_byte_ns or started_ns) > 1.5e9:
            found["imu-silent"] = "imu: no bytes from the sensor; look at its cable and power"
            return found
        if now_ns - (self._last_ns or started_ns) > 2.5e9:
            found["imu-noise"] = (
                f"imu: bytes come but no samples of the format {self._form.name}; are format and "
                "line rate right?"
            )
            return found
        if np.isfinite(state.usual_hz) and self._first_ns is not None:
            off = abs(state.rate_hz - state.usual_hz) > 0.05 * state.usual_hz
            if off and now_ns - self._first_ns > _SETTLE_S * 1e9:
                found["imu-rate"] = (
                    f"imu: {state.rate_hz:.1f} samples a second instead of {state.usual_hz:.1f}"
                )
        while self._bad and now_ns - self._bad[0][0] > _LONG_S * 1e9:
            self._bad.popleft()
        spoiled = sum(count for _, count in self._bad)
        total = sum(b[1] for b in self._batches)
        if spoiled > 3 and spoiled > 0.01 * total:
            found["imu-bad"] = (
                f"imu: {spoiled} of {total} lines of the last ten seconds are damaged"
            )
        if total and self._covered_s() > 0.5 * _LONG_S:
            found |= self._readings(state)
        return found

    def _covered_s(self) -> float:
        return (self._batches[-1][0] - self._batches[0][0]) * 1e-9 if self._batches else 0.0

    def _readings(self, state: ImuState) -> dict[str, str]:
        found: dict[str, str] = {}
        if abs(state.gravity - STANDARD_GRAVITY) > 0.12 * STANDARD_GRAVITY:
            found["imu-gravity"] = (
                f"imu: gravity reads {state.gravity:.2f} m/s^2; unit, scale or an axis is wrong"
            )
        lowest = np.min([b[3] for b in self._batches], axis=0)
        highest = np.max([b[4] for b in self._batches], axis=0)
        # analogue and coarse sensors may stand still for a while on one axis, not on all
        frozen = highest == lowest
        names = ("gx", "gy", "gz", "ax", "ay", "az")
        if np.all(frozen):
            found["imu-frozen"] = "imu: the readings are frozen; the sensor hangs"
        elif np.any(frozen) and np.count_nonzero(~frozen) >= 3:
            dead = ", ".join(name for name, dead in zip(names, frozen, strict=True) if dead)
            found["imu-dead"] = f"imu: {dead} did not change for {self._covered_s():.0f} s"
        return found
