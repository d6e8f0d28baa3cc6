"""Settings of the fuse stage."""

from __future__ import annotations

from pipeline.settings.section import Section


class FuseSettings(Section):
    """Section ``[fuse]`` of the configuration."""
