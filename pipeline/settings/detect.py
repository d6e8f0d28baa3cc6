"""Settings of the detect stage."""

from __future__ import annotations

from pydantic import Field

from pipeline.settings.section import Section


class DetectSettings(Section):
    """Section ``[detect]`` of the configuration."""

    frames_per_s: float = Field(default=10.0, gt=0)
    """At most this many frames of each second of video are searched."""

    min_score: float = Field(default=0.3, ge=0, le=1)
    """Detections below this score are left out."""
