"""All that can be set when signs are located."""

from __future__ import annotations

from dataclasses import dataclass, field

from automap.geolocation import limits
from automap.geolocation.landmark import SizePrior
from automap.geolocation.views import MeasurementNoise


@dataclass(frozen=True)
class GeolocationRules:
    """Of a camera, what its manifest does not state, one sigma: relative ``focal_sd``, and
    ``camera_margin_sd_px`` by which boxes are taller than their signs. ``estimate_camera`` and
    ``estimate_noise``: the camera's turn and time offset, and the scatter of its boxes, from all
    signs; ``adjust_trajectory`` by signs seen again and control signs. A sign that is not seen for
    ``max_silence_s`` is tracked anew. ``max_single_view_m`` is the greatest distance, judged by the
    box's size alone, at which a sign seen once is still put on the map; ``min_existence`` the least
    probability of existence (seen, and missed when it should have been seen) of a sign on the map.
    ``imu_above_road_m`` height of the IMU above the road, with one sigma of it; ``drive`` the
    drive's name."""

    noise: MeasurementNoise = field(default_factory=MeasurementNoise)
    size: SizePrior = field(default_factory=SizePrior)
    focal_sd: float = 0.005
    camera_margin_sd_px: float = 2.0
    estimate_camera: bool = True
    estimate_noise: bool = True
    adjust_trajectory: bool = True
    max_silence_s: float = 20.0
    max_single_view_m: float = 60.0
    min_existence: float = 0.5
    imu_above_road_m: float = limits.IMU_ABOVE_ROAD_M
    imu_above_road_sd_m: float = limits.IMU_ABOVE_ROAD_SD_M
    drive: str = ""
