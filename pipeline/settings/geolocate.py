"""Settings of the geolocate stage."""

from __future__ import annotations

from pydantic import Field, field_validator

from pipeline.settings.section import Section


class GeolocateSettings(Section):
    """Section ``[geolocate]`` of the configuration."""

    pixel_sd: float = Field(default=1.5, gt=0)
    """One sigma of a box centre, pixels."""
    box_fraction: float = Field(default=0.05, ge=0, le=1)
    """One sigma of centre and height of a box, as part of its height."""
    sign_size_m: float = Field(default=0.7, gt=0)
    """Median height of a sign, m."""
    sign_size_log_sd: float = Field(default=0.4, gt=0)
    """Spread of the logarithm of sign heights (0.4: two thirds lie within -33 and +49 %)."""
    max_silence_s: float = Field(default=20.0, gt=0)
    """A sign not seen for so long starts a new track, s."""
    box_margin_sd_px: float = Field(default=2.0, ge=0)
    """One sigma of the height that boxes have beyond their signs, pixels."""
    estimate_noise: bool = True
    """Measure how the boxes scatter about the signs, in place of pixel_sd and box_fraction."""
    adjust_trajectory: bool = True
    """Adjust the trajectory by signs seen again and by control_signs.geojson."""
    estimate_camera: bool = True
    """Estimate the camera's turn and time offset from all signs together."""
    max_single_view_m: float = Field(default=60.0, gt=0)
    """Greatest distance of a sign seen once, judged by its size, m."""
    min_existence: float = Field(default=0.5, ge=0, le=1)
    """Least probability that a sign exists, from seen and not seen when it should have been."""
    focal_sd: float = Field(default=0.005, ge=0)
    """One sigma of the focal length, as part of it."""
    lever_arm_sd_m: float = Field(default=0.3, ge=0)
    """One sigma of the camera's place on the vehicle, m."""
    fixed: dict[str, dict[str, dict[str, float]]] = Field(default_factory=dict)
    """Errors of the stated cameras that are known: camera, effect, parameter, value."""
    single_sightings: bool = False
    """In bearings.csv, whether a sighting that meets no other makes an object by its depth."""
    imu_above_road_m: float = Field(default=1.0, ge=0)
    """Height of the IMU above the road, m."""

    @field_validator("fixed")
    @classmethod
    def _effects_exist(
        cls, value: dict[str, dict[str, dict[str, float]]]
    ) -> dict[str, dict[str, dict[str, float]]]:
        from automap.effects import CATALOGUE

        known = {n: e for n, e in CATALOGUE.items() if e.family == "camera"}
        for effects in value.values():
            for effect, given in effects.items():
                if effect not in known:
                    raise ValueError(
                        f"no effect of a camera '{effect}'; there are " + ", ".join(known)
                    )
                names = [p.name for p in known[effect].parameters]
                wrong = sorted(set(given) - set(names))
                if wrong:
                    raise ValueError(
                        f"'{effect}' has no parameter '{wrong[0]}'; it has " + ", ".join(names)
                    )
        return value
