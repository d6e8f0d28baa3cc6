"""Which manoeuvre tells effects apart that a drive could not."""

from __future__ import annotations

from collections.abc import Collection

_PAIRS: dict[frozenset[str], str] = {
    frozenset({"gnss_latency", "imu_time_offset"}): (
        "late fixes and late IMU stamps look the same to IMU and receiver; compare with wheel "
        "speeds on the host clock, or tap the IMU against a timed event"
    ),
    frozenset({"gnss_velocity_latency", "gnss_velocity_lag"}): (
        "brake hard to a halt a few times: after the halt a lag dies away slowly, a latency "
        "ends at once"
    ),
    frozenset({"gnss_latency", "gnss_lever_arm"}): (
        "drive the same tight circle slowly both ways: a lever arm does not grow with speed"
    ),
    frozenset({"gnss_velocity_latency", "gnss_lever_arm"}): (
        "drive the same tight circle slowly both ways: a lever arm does not grow with speed"
    ),
    frozenset({"gyro_misalignment", "gyro_g_sensitivity"}): (
        "drive slow tight circles, and brake hard on a straight"
    ),
    frozenset({"nhc_lever_arm", "vehicle_sideslip"}): (
        "drive the same bend once slowly and once fast: slip grows with the square of the speed"
    ),
    frozenset({"accel_misalignment", "imu_mounting"}): (
        "accelerate and brake on a straight, level road, and drive it back"
    ),
    frozenset({"accel_temperature", "accel_bias_walk"}): "start once cold and once warm",
    frozenset({"gyro_temperature", "gyro_bias_walk"}): "start once cold and once warm",
    frozenset({"accel_quadratic", "accel_scale"}): "record twelve poses on a desk",
    frozenset({"accel_scale", "accel_scale_asymmetry"}): "record twelve poses on a desk",
    frozenset({"imu_clock_skew", "imu_time_offset"}): "record a drive of half an hour or more",
    frozenset({"imu_clock_skew", "gnss_latency"}): "record a drive of half an hour or more",
}
GENERAL = (
    "drive figures of eight at two speeds, brake and accelerate hard on a straight, and stand "
    "still for half a minute in between"
)


def advice(effect: str, confusable: Collection[str]) -> str:
    """The manoeuvre that tells an effect from its rivals, nothing without any."""
    if not confusable:
        return ""
    known = [_PAIRS[p] for r in confusable if (p := frozenset({effect, r})) in _PAIRS]
    return "; ".join(dict.fromkeys(known)) or GENERAL
