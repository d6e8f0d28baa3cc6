"""Settings of the sync stage."""

from __future__ import annotations

from pydantic import Field

from pipeline.settings.section import Section


class SyncSettings(Section):
    """Section ``[sync]`` of the configuration."""

    drift_sd_ppm: float = Field(default=50.0, gt=0)
    """parts per million, one sigma of the host clock's rate error"""
