"""Which classes a detector gives to the backs of signs."""

from __future__ import annotations

from automap.signs.vocabulary import load_vocabulary

COLOURLESS = ("white-square", "white-diamond", "white-circle", "black-square", "other")
"""Groups of shape and colour that a back may be taken for."""


def is_back(class_name: str) -> bool:
    """Whether a class is that of backs and of nothing else."""
    return class_name.lower().replace("_", "-").split("-")[-1] in ("back", "backside")


def may_be_back(class_name: str) -> bool:
    """Whether a detector gives such a class to a back: its own, or a face without colours that
    could not be read."""
    groups = load_vocabulary().groups
    return is_back(class_name) or class_name in {groups[g] for g in COLOURLESS if g in groups}
