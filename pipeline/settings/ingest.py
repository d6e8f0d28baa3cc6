"""Settings of the ingest stage."""

from __future__ import annotations

from pydantic import Field

from pipeline.settings.section import Section


class IngestSettings(Section):
    """Section ``[ingest]`` of the configuration."""

    gap_factor: float = Field(default=2.5, gt=1)
    """multiples of the median step between IMU stamps: longer is a gap"""
