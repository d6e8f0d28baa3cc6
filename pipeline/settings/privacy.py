"""Settings of what pictures show that leave the drive's folder."""

from __future__ import annotations

from pipeline.settings.section import Section


class PrivacySettings(Section):
    """Section ``[privacy]`` of the configuration."""

    hide_street: bool = True
    """in pictures of streets all but the signs is so coarse that nobody can be recognised"""
