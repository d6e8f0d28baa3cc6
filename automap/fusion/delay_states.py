"""States of the filter that are delays, and what part of them the nodes' times contain."""

from __future__ import annotations

from automap.fusion.nodes import Shift

DELAY_STATE = "imu_time_offset_s"
VEL_LATENCY_STATE = "gnss_velocity_latency_s"
LATENCY_STATE = "gnss_latency_s"
SKEW_STATE = "imu_clock_skew_skew"
VEL_LAG_STATE = "gnss_velocity_lag_tau"
COURSE_STATE = "gnss_course_latency_s"
COURSE_DISTANCE_STATE = "gnss_course_distance_m"
WHEELS_STATE = "odometer_time_offset_s"


def contained(shift: Shift) -> tuple[tuple[str, float], ...]:
    """States of which the nodes' times contain a part, and that part."""
    return (
        (DELAY_STATE, shift.delay_s),
        (VEL_LATENCY_STATE, shift.vel_latency_s),
        (LATENCY_STATE, shift.latency_s),
        (SKEW_STATE, shift.skew),
        (VEL_LAG_STATE, shift.vel_lag_s),
        (COURSE_STATE, shift.course_s),
        (WHEELS_STATE, shift.wheels_s),
    )
