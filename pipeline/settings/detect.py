"""Settings of the detect stage."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydantic import Field

from pipeline.settings.section import Section

if TYPE_CHECKING:
    from automap.vision.search import SearchRules


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

    min_score: float = Field(default=0.3, ge=0, le=1)
    """Detections below this score are left out."""

    detector: str = ""
    """Description (TOML) of a detector of your own; empty for the one that comes with AutoMap."""


def search_rules(settings: DetectSettings) -> SearchRules:
    """The library's rules from the stage's settings."""
    from math import radians

    from automap.vision.frame_choice import ChoiceRules
    from automap.vision.search import SearchRules

    return SearchRules(
        min_score=settings.min_score,
        every=settings.every_frame,
        choice=ChoiceRules(
            step_m=settings.step_m,
            step_rad=radians(settings.step_deg),
            idle_s=settings.idle_s,
            shortest_s=1.0 / settings.frames_per_s,
        ),
    )
