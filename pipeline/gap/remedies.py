"""What to do about a missing effect: measure, state, recalibrate, or take the new model."""

from __future__ import annotations

from automap.effects import CATALOGUE

MODEL = "Or take model.toml, which has it."
TAKE_MODEL = "Take model.toml, which has it."
_CALIBRATE = (
    "Calibrate the IMU again with automap calibrate and name the result as calibration under [imu] "
    f"in drive.toml. {MODEL}"
)
_DESK = (
    "Log some twelve poses on a desk and give them to automap gap --accel ACC --gyro GYRO, which "
    f"measures it without the road. {MODEL}"
)
_CLOCK = (
    "Mend the clock of the recorder, or state the receiver's output_delay_s under [gnss] in "
    f"drive.toml. {MODEL}"
)
_SMOOTHING = (
    "Set the receiver to smooth less (a livelier motion model, velocities by Doppler). " + MODEL
)
_WARM = f"Switch the sensor on half an hour before the drive, or record its temperature. {MODEL}"
_DRIFT = (
    "Let the sensor warm up, and measure its drift with automap calibrate allan. model.toml has "
    "the drift that was found."
)
_RANGE = f"Set the sensor or its recorder to another range or a finer step. {MODEL}"
_VIBRATION = f"Mount the IMU where it shakes less, stiffly and away from the engine. {MODEL}"
_SKY = (
    "Give the antenna a free view of the sky, away from other metal; the receiver's raw data or "
    "corrections from a base help where streets are narrow."
)
_OF_THE_CAR = f"That is how the car is, and nothing to mend. {TAKE_MODEL}"
_WHEELS = f"Correct the wheel factor or the stamps of the odometer. {MODEL}"


def _in_video(key: str, what: str) -> str:
    return f"{what} and write it as {key} under the camera in drive.toml. {MODEL}"


_BY_EFFECT = {
    "gnss_lever_arm": "Measure again from the IMU to the antenna and write it as lever_arm_m under "
    f"[gnss] in drive.toml. {MODEL}",
    "gnss_latency": _CLOCK,
    "imu_time_offset": _CLOCK,
    "imu_clock_skew": f"Time the IMU by the receiver's pulse or a better clock. {MODEL}",
    "imu_mounting": "Measure how the IMU sits and state it as axes (a matrix) under [imu] in "
    f"drive.toml, or fasten it anew. {MODEL}",
    "imu_filter_delay": "Set accelerometer and gyro to the same low-pass and stamp them together. "
    + MODEL,
    "gnss_velocity_latency": _SMOOTHING,
    "gnss_velocity_lag": _SMOOTHING,
    "gnss_course_latency": _SMOOTHING,
    "gnss_course_distance": _SMOOTHING,
    "gnss_velocity_scale": f"Check the unit of the receiver's speeds. {MODEL}",
    "gnss_speed_offset": "That is how the receiver is, and nothing to mend: every search estimates "
    "it along.",
    "gnss_noise_scale": "Do not trust the accuracy that this receiver states. model.toml has the "
    "one that was found.",
    "gnss_outliers": f"{_SKY} The run leaves such fixes out by itself.",
    "gnss_datum_shift": "Compare the receiver's datum and base coordinates with the map's.",
    "gnss_freeze": "Set the receiver not to hold its position.",
    "gnss_speed_threshold": "Switch off the receiver's static hold.",
    "earth_rotation": "Set earth_rotation = true under [fuse] in the settings. " + MODEL,
    "nhc_lever_arm": "Measure from the IMU to the middle of the rear axle and state it under "
    f"[fuse.fixed.nhc_lever_arm] in the settings. {MODEL}",
    "vehicle_sideslip": _OF_THE_CAR,
    "vehicle_pitch": _OF_THE_CAR,
    "odometer_scale": _WHEELS,
    "odometer_time_offset": _WHEELS,
    "camera_boresight": _in_video("mount_rpy_deg", "Measure how the camera looks"),
    "camera_lever_arm": _in_video("lever_arm_m", "Measure again from the IMU to the camera"),
    "camera_time_offset": _in_video("time_offset_s", "Find the offset of its clock"),
    "camera_focal": _in_video("camera_matrix", "Calibrate the camera again"),
    "camera_distortion": _in_video("distortion", "Calibrate the camera again"),
    "rolling_shutter": f"Use a camera with a global shutter. {MODEL}",
    "accel_temperature": _WARM,
    "gyro_temperature": _WARM,
    "accel_warm_up": _WARM,
    "gyro_warm_up": _WARM,
    "accel_bias_walk": _DRIFT,
    "gyro_bias_walk": _DRIFT,
    "speed_vibration": _VIBRATION,
    "gyro_speed_vibration": _VIBRATION,
    "accel_saturation": _RANGE,
    "gyro_saturation": _RANGE,
    "accel_dead_zone": _RANGE,
    "gyro_dead_zone": _RANGE,
    "accel_bias": _CALIBRATE,
    "gyro_bias": _CALIBRATE,
    "accel_scale": _CALIBRATE,
    "gyro_scale": _CALIBRATE,
    "accel_misalignment": _CALIBRATE,
    "gyro_misalignment": _CALIBRATE,
}
_BY_FAMILY = {"imu": _DESK, "gnss": _SKY}


def remedy(effect: str) -> str:
    """What to do about an effect, also where it is the user's own."""
    known = CATALOGUE.get(effect)
    by_family = _BY_FAMILY.get(known.family, TAKE_MODEL) if known and known.terms else TAKE_MODEL
    return _BY_EFFECT.get(effect, by_family)
