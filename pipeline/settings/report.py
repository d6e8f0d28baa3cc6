"""Settings of the report stage."""

from __future__ import annotations

from pipeline.settings.section import Section


class ReportSettings(Section):
    """Section ``[report]`` of the configuration."""

    background: str = ""
    """file of pictures, tiles or lines below the report's map; "" is the drive's own"""
