"""Whether the IMU's stamps keep time with the receiver's epochs over the drive."""

from __future__ import annotations

import numpy as np

from automap.evaluation.plausibility import Finding
from automap.records import ClockModel, Fixes, ImuData
from automap.sync.clock import contradiction
from automap.sync.steadiness import ClockChange, clock_change, lags_by_piece

OFFSET_CODE = "imu_clock_offset"
"""Of a finding about stamps that are seconds off: nothing can be done with them."""
CODES = {"rate": "imu_clock_rate", "jump": "imu_clock_jump"}
"""Of findings about stamps that run off, and that jump."""


def offset(imu: ImuData, fixes: Fixes | None, clock: ClockModel | None) -> Finding | None:
    """An error for stamps that are seconds off the receiver's time, by the motions of both."""
    text = contradiction(clock, imu, fixes)
    return None if text is None else Finding("error", text.rstrip("."), code=OFFSET_CODE)


def check(imu: ImuData, fixes: Fixes | None, clock: ClockModel | None) -> list[Finding]:
    """An error for stamps that jump or run off against the receiver, by the motions of both."""
    if fixes is None or not len(fixes):
        return []
    change = clock_change(lags_by_piece(imu, fixes, clock))
    if change is None:
        return []
    text, advice = _jump(change, imu) if change.kind == "jump" else _rate(change)
    return [Finding("error", text, advice, CODES[change.kind])]


def _jump(change: ClockChange, imu: ImuData) -> tuple[str, str]:
    first, last = (
        int(imu.t_ns[0]) + round(seconds * 1e9) for seconds in (change.first_s, change.last_s)
    )
    gap = _gap_like(change, imu, first, last)
    where = f"between t_ns {first} and {last}" if gap is None else f"after t_ns {gap}"
    text = (
        f"the IMU's stamps jump by {change.size:+.2f} s (sigma {change.sd:.2f}) against the "
        f"receiver's time, as both felt the turns and speed changes, {where} "
        f"({change.first_s:.0f} to {change.last_s:.0f} s after the first reading)"
    )
    return text, (
        "a clock was set, readings were lost, or the receiver learnt its leap seconds while it "
        "recorded: stamp with a monotonic clock, or correct the stamps from there on, or cut the "
        "drive in two there"
    )


def _gap_like(change: ClockChange, imu: ImuData, first: int, last: int) -> int | None:
    """The stamp before the step between readings that is the jump, None where none is."""
    begin, end = np.searchsorted(imu.t_ns, (first, last))
    steps = np.diff(imu.t_ns[begin:end]) * 1e-9
    if change.size <= 0.0 or not len(steps):
        return None
    k = int(np.argmax(steps))
    usual = float(np.median(steps))
    if abs(float(steps[k]) - usual - change.size) > 3.0 * change.sd:
        return None
    return int(imu.t_ns[begin + k])


def _rate(change: ClockChange) -> tuple[str, str]:
    since = ""
    if change.last_s > 0.0:
        since = f", beginning {change.first_s:.0f} to {change.last_s:.0f} s after the first reading"
    fast = "fast" if change.size > 0.0 else "slow"
    text = (
        f"the IMU's clock is {100.0 * abs(change.size):.2g} % {fast} "
        f"(sigma {100.0 * change.sd:.1g} %) against the receiver's time{since}, as both felt the "
        "turns and speed changes"
    )
    return text, (
        "crystals are off by a hundredth of that: look how t_ns was made, as of a nominal sampling "
        "rate or wrong ticks, and stamp with the clock"
        + ("; or IMU and receiver are not of one vehicle from there on" if since else "")
    )
