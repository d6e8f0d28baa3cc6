"""Settings of the export stage."""

from __future__ import annotations

from pydantic import Field

from pipeline.settings.section import Section


class ExportSettings(Section):
    """Section ``[export]`` of the configuration."""

    min_confidence: float = Field(default=0.0, ge=0.0, le=1.0)
    """Signs less sure than this are left out of the map."""
    pictures: bool = True
    """Whether pictures of the signs are cut out of the video."""
