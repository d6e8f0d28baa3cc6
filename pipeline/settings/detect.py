"""Settings of the detect stage."""

from __future__ import annotations

from pydantic import Field

from pipeline.settings.section import Section


class DetectSettings(Section):
    """Section ``[detect]`` of the configuration."""

    step_m: float = Field(default=2.0, gt=0)
    """m of road between two searched frames of an approach; twice that on empty road"""
    step_deg: float = Field(default=3.0, gt=0)
    """degrees of turn that count as much as step_m"""
    idle_s: float = Field(default=2.0, gt=0)
    """s after which a frame is searched even if nothing has moved"""
    frames_per_s: float = Field(default=15.0, gt=0)
    """frames of each second of video that are searched, at most"""
    every_frame: bool = False
    """search every frame; the four settings above then mean nothing"""
    height_share: float = Field(default=0.89, gt=0, le=1)
    """part of a video's picture, from its top, that is searched; lower are road and bonnet"""
    min_score: float = Field(default=0.3, ge=0, le=1)
    """0..1, detections below are left out"""
    detector: str = ""
    """file (TOML) that describes a detector of your own; empty: the built-in one"""
