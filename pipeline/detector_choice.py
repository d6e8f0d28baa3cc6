"""Which detector a run uses."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from automap.vision.detector import Detector


def open_detector(description: str, country: str | None) -> Detector:
    """The detector that a TOML file describes, or AutoMap's own for signs of a country.

    Raises ConfigError or InputError for a description or a model that cannot be used.
    """
    if description:
        from automap.vision.custom import CustomDetector

        return CustomDetector(Path(description).expanduser())
    from automap.vision.classical import ClassicalDetector

    return ClassicalDetector()
