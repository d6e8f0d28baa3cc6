"""Settings of the detect stage."""

from __future__ import annotations

from pydantic import Field

from pipeline.settings.section import Section


class DetectSettings(Section):
    """Section ``[detect]`` of the configuration."""

    step_m: float = Field(default=2.0, gt=0)
    """Metres of road between two searched frames of an approach; twice that on empty road."""

    step_deg: float = Field(default=3.0, gt=0)
    """Degrees of turn that count as much as ``step_m``."""

    idle_s: float = Field(default=2.0, gt=0)
    """Seconds after which a frame is searched even if nothing has moved."""

    frames_per_s: float = Field(default=15.0, gt=0)
    """At most this many frames of each second of video are searched."""

    every_frame: bool = False
    """Search every frame; the four settings above then mean nothing."""

    height_share: float = Field(default=0.89, gt=0, le=1)
    """Part of a video's picture, from its top, that is searched; lower are road and bonnet."""

    min_score: float = Field(default=0.3, ge=0, le=1)
    """Detections below this score are left out."""

    detector: str = ""
    """Description (TOML) of a detector of your own; empty for the one that comes with AutoMap."""
