"""Settings of the export stage."""

from __future__ import annotations

from pydantic import Field, field_validator

from pipeline.settings.section import Section


class ExportSettings(Section):
    """Section ``[export]`` of the configuration."""

    min_confidence: float = Field(default=0.0, ge=0.0, le=1.0)
    """0..1, signs less sure are left out of the map"""
    datum: str = ""
    """of the GIS files, as "GDA2020@2026.5"; "" is WGS-84"""
    pictures: bool = True
    """pictures of the signs, cut out of the video, beside the map"""
    context: bool = True
    """with them one of the street around each sign, in which nobody can be recognised"""
    roads: str = ""
    """file of road lines: signs get road, chainage and side; "" is the drive's own"""

    @field_validator("datum", mode="after")
    @classmethod
    def _datum_exists(cls, value: str) -> str:
        from automap.errors import ConfigError
        from automap.export.datum import parse_datum

        if value:
            try:
                parse_datum(value)
            except ConfigError as error:
                raise ValueError(str(error)) from None
        return value
