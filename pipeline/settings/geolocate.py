"""Settings of the geolocate stage."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from pydantic import Field

from automap.errors import ConfigError
from pipeline.settings.section import Section

if TYPE_CHECKING:
    from automap.effects import Effect


class GeolocateSettings(Section):
    """Section ``[geolocate]`` of the configuration."""

    pixel_sd: float = Field(default=1.5, gt=0)
    """pixels, one sigma of a box centre"""
    box_fraction: float = Field(default=0.05, ge=0, le=1)
    """one sigma of centre and height of a box, part of its height"""
    sign_size_m: float = Field(default=0.7, gt=0)
    """m, median height of a sign"""
    sign_size_log_sd: float = Field(default=0.4, gt=0)
    """spread of the logarithm of sign heights"""
    max_silence_s: float = Field(default=20.0, gt=0)
    """s, a sign not seen for so long starts a new track"""
    box_margin_sd_px: float = Field(default=2.0, ge=0)
    """pixels, one sigma of the height of boxes beyond their signs"""
    estimate_noise: bool = True
    """measure how the boxes scatter, in place of pixel_sd and box_fraction"""
    adjust_trajectory: bool = True
    """by signs seen again and by control_signs.geojson"""
    estimate_camera: bool = True
    """turn and time offset of the camera from all signs together"""
    max_single_view_m: float = Field(default=60.0, gt=0)
    """m, greatest distance of a sign seen once"""
    min_existence: float = Field(default=0.5, ge=0, le=1)
    """0..1, least probability that a sign exists (seen, and not missed)"""
    focal_sd: float = Field(default=0.005, ge=0)
    """one sigma of the focal length, part of it"""
    fixed: dict[str, dict[str, dict[str, float]]] = Field(default_factory=dict)
    """known errors of the stated cameras: { camera = { effect = { parameter = value } } }"""
    single_sightings: bool = False
    """bearings.csv: objects by the depth of one sighting alone"""

    def check_fixed(self, users: Iterable[Effect], source: str) -> None:
        """Refuse known errors of cameras that are none.

        ``users`` effects beside those of the catalogue.

        Raises:
            ConfigError: an effect or a parameter that does not exist.
        """
        from automap.effects import CATALOGUE

        every = {**CATALOGUE, **{e.name: e for e in users}}
        known = {n: e for n, e in every.items() if e.family == "camera"}
        for camera, effects in self.fixed.items():
            place = f"{source}: geolocate.fixed.{camera}"
            for effect, given in effects.items():
                if effect not in known:
                    raise ConfigError(
                        f"{place}: no effect of a camera '{effect}'; there are " + ", ".join(known)
                    )
                names = [p.name for p in known[effect].parameters]
                wrong = sorted(set(given) - set(names))
                if wrong:
                    raise ConfigError(
                        f"{place}: '{effect}' has no parameter '{wrong[0]}'; it has "
                        + ", ".join(names)
                    )
