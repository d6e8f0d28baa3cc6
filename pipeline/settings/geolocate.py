"""Settings of the geolocate stage."""

from __future__ import annotations

from pydantic import Field

from pipeline.settings.section import Section


class GeolocateSettings(Section):
    """Section ``[geolocate]`` of the configuration."""

    pixel_sd: float = Field(default=1.5, gt=0)
    """One sigma of a box centre, pixels."""
