"""The sign classes: names, usual size, and how a face is drawn."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from automap.signs.classes import load_classes

SHAPES = ("circle", "octagon", "triangle-up", "triangle-down", "diamond", "square")


@dataclass(frozen=True)
class SignClass:
    """One class of sign. ``size_m`` is the usual width; ``group`` its colour and shape."""

    name: str
    group: str
    outline: str
    size_m: float
    fill: str
    border: str
    border_width: float
    rim: str
    marks: tuple[dict[str, Any], ...]


@dataclass(frozen=True)
class Vocabulary:
    """All classes by name, the names of the groups, and the colours (R, G, B)."""

    classes: dict[str, SignClass]
    groups: dict[str, str]
    colours: dict[str, tuple[int, int, int]]

    def group_of(self, class_name: str) -> str | None:
        """The colour-shape group of a class or of a group's own name; None if unknown."""
        if class_name in self.classes:
            return self.classes[class_name].group
        if class_name in load_classes():
            return load_classes()[class_name].group
        return next((g for g, name in self.groups.items() if name == class_name), None)


@cache
def load_vocabulary() -> Vocabulary:
    """The vocabulary that comes with the package."""
    text = files("automap.signs").joinpath("data/vocabulary.toml").read_text(encoding="utf-8")
    data = tomllib.loads(text)
    classes = {
        item["name"]: SignClass(**{**item, "marks": tuple(item["marks"])}) for item in data["class"]
    }
    colours = {name: (rgb[0], rgb[1], rgb[2]) for name, rgb in data["colours"].items()}
    return Vocabulary(classes=classes, groups=data["groups"], colours=colours)
