"""Faces of classes that have none of their own."""

from __future__ import annotations

from automap.export.icons import class_icon, icon_text
from automap.signs.vocabulary import load_vocabulary


def test_a_sign_that_is_not_known_bears_no_letters_that_a_sign_could() -> None:
    assert icon_text("regulatory--unknown-blue-circle") == "?"
    assert icon_text("regulatory--maximum-speed-limit-45--g1") == "45"


def test_no_two_groups_look_alike() -> None:
    unknown = sorted(set(load_vocabulary().groups.values()))
    assert len({class_icon(name) for name in unknown}) == len(unknown)
