"""What the camera's own model holds."""

from __future__ import annotations

from automap.effects.effect import Effect
from automap.effects.entries.parts import ROLL_PITCH_YAW, named, xyz

CAMERA = (
    Effect("camera_boresight", "camera", named(ROLL_PITCH_YAW, "rad", 0.03), "camera turned"),
    Effect(
        "camera_time_offset",
        "camera",
        named("s", "s", 0.1),
        "frame stamps off",
        told_apart=(
            ("rolling_shutter", "film signs high and low in the picture while turning"),
            (
                "camera_lever_arm",
                "pass signs at two speeds: an offset grows with the speed, a lever arm does not",
            ),
        ),
    ),
    Effect("rolling_shutter", "camera", named("s", "s/image height", 0.03), "rows read in turn"),
    Effect(
        "camera_focal",
        "camera",
        named("relative", "", 0.02),
        "focal length off",
        told_apart=(
            ("camera_distortion", "film signs in the corners of the picture"),
            ("camera_lever_arm", "pass signs near and far, to both sides of the road"),
        ),
    ),
    Effect("camera_distortion", "camera", named("k1 k2", "", 0.05), "lens distortion off"),
    Effect(
        "camera_lever_arm",
        "camera",
        xyz("m", 0.3),
        "camera away from where it is said",
        told_apart=(("camera_boresight", "film signs near and far"),),
    ),
)
