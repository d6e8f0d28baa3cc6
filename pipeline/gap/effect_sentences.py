"""Every effect of the catalogue in plain words."""

from __future__ import annotations

from collections.abc import Mapping

from pipeline.gap.sensor_sentences import INERTIAL
from pipeline.gap.sentence_parts import ARM, DEGREES, HOUR, LOOKS, SITS, Sentence, one, wander

_INSTALLATION = {
    "imu_mounting": Sentence(
        "The IMU does not sit in the vehicle as the manifest says: it is {}.", SITS
    ),
    "imu_time_offset": Sentence(
        "The IMU's time stamps are {}.", one("s", "{} too late", "{} too early")
    ),
    "imu_clock_skew": Sentence(
        "The IMU's clock {}.",
        one("skew", "gains {} an hour", "loses {} an hour", HOUR),
    ),
    "earth_rotation": Sentence(
        "The gyro feels the Earth turn (15° an hour), and the model leaves that out.", {}
    ),
    "vehicle_sideslip": Sentence(
        "In bends the car drifts outwards: its path points {}.",
        one(
            "coefficient",
            "{} outwards of its nose for every m/s² of sideways acceleration",
            "{} inwards of its nose for every m/s² of sideways acceleration",
            DEGREES,
            "°",
        ),
    ),
    "vehicle_pitch": Sentence(
        "The car pitches on its springs: {}.",
        one(
            "coefficient",
            "its nose rises {} for every m/s² of acceleration",
            "its nose drops {} for every m/s² of acceleration",
            DEGREES,
            "°",
        ),
    ),
    "nhc_lever_arm": Sentence(
        "The point of the car that does not slide sideways, near the rear axle, is {} than the "
        "model has it.",
        ARM,
    ),
    "odometer_scale": Sentence(
        "The wheels tell a speed that is {}.",
        one("relative", "{} too high", "{} too low", 100.0, "%"),
    ),
    "odometer_time_offset": Sentence(
        "The wheel speeds are stamped {}.", one("s", "{} too late", "{} too early")
    ),
}

_RECEIVER = {
    "gnss_lever_arm": Sentence("The antenna is {} than the manifest says.", ARM),
    "gnss_latency": Sentence(
        "The receiver's fixes are {} than their time tags say.", one("s", "{} older", "{} newer")
    ),
    "gnss_velocity_latency": Sentence(
        "The receiver's velocities are {} than the positions of the same fix.",
        one("s", "{} older", "{} newer"),
    ),
    "gnss_velocity_lag": Sentence(
        "The receiver smooths its velocities: they follow the car with a time constant of {}.",
        one("tau", "{}"),
    ),
    "gnss_course_latency": Sentence(
        "The direction of the receiver's velocities is {} than their size.",
        one("s", "{} older", "{} newer"),
    ),
    "gnss_course_distance": Sentence(
        "The direction of the receiver's velocities is that of a place {} behind.",
        one("m", "{}", unit="m"),
    ),
    "gnss_velocity_scale": Sentence(
        "The receiver's speeds are {}.",
        one("relative", "{} too high", "{} too low", 100.0, "%"),
    ),
    "gnss_speed_offset": Sentence(
        "The receiver's speeds are {}, however fast the car goes.",
        one("along", "{} too high", "{} too low", unit="m/s"),
    ),
    "gnss_correlated_noise": Sentence("The receiver's positions wander {}.", wander("m")),
    "gnss_multipath": Sentence(
        "The receiver's positions are pushed aside, as by reflections, {}.", wander("m")
    ),
    "gnss_velocity_wander": Sentence("The receiver's velocities wander {}.", wander("m/s")),
    "gnss_noise_scale": Sentence(
        "The receiver's errors are {} as large as it states.", one("factor", "{} times", unit="")
    ),
    "gnss_outliers": Sentence(
        "Some of the receiver's fixes are wild: {}.", one("fraction", "{}", factor=100.0, unit="%")
    ),
    "gnss_slow_wander": Sentence("The receiver's level positions wander slowly, {}.", wander("m")),
    "gnss_height_wander": Sentence("The receiver's heights wander slowly, {}.", wander("m")),
    "gnss_position_steps": Sentence(
        "The receiver's positions jump {}.",
        one("size", "by {}", unit="m") | one("interval", "every {} or so"),
    ),
    "gnss_freeze": Sentence(
        "The receiver's position stands still while its time goes on, {}.",
        one("length", "for {}") | one("interval", "every {} or so"),
    ),
    "gnss_speed_threshold": Sentence(
        "The receiver says that the car stands while it creeps: {}.",
        one("speed", "below {}", unit="m/s"),
    ),
    "gnss_datum_shift": Sentence(
        "All of the receiver's positions are shifted: {}.",
        one("n", "{} to the north", "{} to the south", unit="m")
        | one("e", "{} to the east", "{} to the west", unit="m")
        | one("d", "{} down", "{} up", unit="m"),
    ),
}

_CAMERA = {
    "camera_boresight": Sentence("The camera looks elsewhere than the manifest says: {}.", LOOKS),
    "camera_time_offset": Sentence(
        "The camera's pictures were taken {} than their stamps say.",
        one("s", "{} later", "{} earlier"),
    ),
    "rolling_shutter": Sentence(
        "The camera does not read its rows at once: it takes {}.",
        one("s", "{} from the top to the bottom", "{} from the bottom to the top"),
    ),
    "camera_focal": Sentence(
        "The camera's focal length is {} than stated.",
        one("relative", "{} longer", "{} shorter", 100.0, "%"),
    ),
    "camera_distortion": Sentence(
        "The lens bends the picture otherwise than stated: {}.",
        one("k1", "k1 is {} larger", "k1 is {} smaller", unit="")
        | one("k2", "k2 is {} larger", "k2 is {} smaller", unit=""),
    ),
    "camera_lever_arm": Sentence("The camera is {} than the manifest says.", ARM),
}

SENTENCES: Mapping[str, Sentence] = {**INERTIAL, **_INSTALLATION, **_RECEIVER, **_CAMERA}
"""By the name of the effect. An effect that is not here is told by its summary."""
