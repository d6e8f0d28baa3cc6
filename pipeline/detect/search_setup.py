"""What the section ``[detect]`` of the configuration means for a search."""

from __future__ import annotations

import glob
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from automap.vision.custom import Description
    from automap.vision.detector import Detector
    from automap.vision.search import SearchRules
    from pipeline.settings.detect import DetectSettings
    from pipeline.settings.load import Settings

_WIDTH_OF_MANY = 1440


def open_detector(settings: DetectSettings, country: str | None) -> Detector:
    """The user's own detector, or AutoMap's for the signs of a country.

    Raises ConfigError or InputError for a description or a model that cannot be used.
    """
    if settings.detector:
        from automap.vision.custom import CustomDetector

        path = _path(settings.detector)
        return CustomDetector(path, read_description(path))
    from automap.vision.network import NetworkDetector, NetworkRules

    rules = NetworkRules(
        # what the search would not even look at again need not be named
        min_score=max(search_rules(settings).hint, 0.01),
        # every frame shows a sign so often that a few pixels less do no harm
        width=_WIDTH_OF_MANY if settings.every_frame else NetworkRules.width,
    )
    return NetworkDetector(country=country, rules=rules)


def read_description(path: Path) -> Description:
    """The description of a user's detector; ConfigError names the file and what is wrong."""
    from automap.io.toml_file import read_toml
    from automap.vision.custom import parse_description

    return parse_description(read_toml(path, "detector"), path)


def detector_files(settings: Settings) -> list[Path]:
    """The files that make the detector, as far as they are known."""
    if not settings.detect.detector:
        import automap.vision

        return sorted((Path(automap.vision.__path__[0]) / "models").glob("*.onnx"))
    from automap.errors import ConfigError

    path = _path(settings.detect.detector)
    try:
        model = path.parent / read_description(path).model
        # large weights stand in files beside the model
        return [path, *sorted({model, *model.parent.glob(f"{glob.escape(model.name)}*")})]
    except ConfigError:
        return [path]  # the stage says what is wrong with it


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
        height_share=settings.height_share,
        # other networks may scale what they are given
        windows=not settings.detector,
    )


def _path(text: str) -> Path:
    return Path(text).expanduser()
