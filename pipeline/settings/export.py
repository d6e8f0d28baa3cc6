"""Settings of the export stage."""

from __future__ import annotations

from pipeline.settings.section import Section


class ExportSettings(Section):
    """Section ``[export]`` of the configuration."""
