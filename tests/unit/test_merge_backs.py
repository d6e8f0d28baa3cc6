"""Drives the other way see the backs of signs; the map has each sign once."""

from __future__ import annotations

import numpy as np
from merge_scene import Errors, Town, drive_through

from automap.mapping.limits import LEAST_EXISTENCE
from automap.mapping.merge import merge_drives
from automap.records import Sign

STOP, GREY = "regulatory--stop--g1", "information--unknown-other"
DAY_S = 86400.0


def on_the_map(behind: str, faces_twelve: bool = True) -> list[Sign]:
    """The map of a straight street driven four times each way; what stands back to back with 12
    signs."""
    rng = np.random.default_rng(5)
    along = 40.0 + 60.0 * np.arange(12)
    place = np.column_stack([np.full(12, -5.0), along, np.full(12, 2.4)])
    fronts = (np.full(12, np.pi), np.full(12, STOP, object))
    back = (np.zeros(12), np.full(12, behind, object))
    kept = slice(None) if faces_twelve else slice(0, 0)
    town = Town(
        np.vstack([place[kept], place]),
        np.concatenate([fronts[0][kept], back[0]]),
        np.concatenate([fronts[1][kept], back[1]]),
    )
    usual = Errors(clutter=0.0, wrong_class=0.0, missed=0.0)
    drives = []
    for k in range(8):
        path = np.array([[0.0, 0.0], [0.0, 800.0]])[:: 1 if k % 2 else -1]
        drives.append(drive_through(rng, town, path, 12.0, f"d{k}", 1.4e9 + k * DAY_S, usual)[0])
    merged = merge_drives(drives)
    rows = zip(merged.signs, merged.existence, strict=True)
    return [sign for sign, there in rows if there >= LEAST_EXISTENCE]


def names_on_the_map(behind: str, faces_twelve: bool = True) -> list[str]:
    return sorted(sign.class_name for sign in on_the_map(behind, faces_twelve))


def test_a_grey_face_behind_a_sign_is_its_back() -> None:
    signs = on_the_map(GREY)
    assert [sign.class_name for sign in signs] == [STOP] * 12
    # four drives saw each from behind
    assert min(sign.n_back_views for sign in signs) >= 4


def test_a_sign_behind_a_sign_is_a_sign() -> None:
    yields = "regulatory--yield--g1"
    assert names_on_the_map(yields) == sorted([STOP] * 12 + [yields] * 12)


def test_a_grey_face_alone_stays() -> None:
    assert names_on_the_map(GREY, faces_twelve=False) == [GREY] * 12
