"""Signs of a merged map that are on one post."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from automap.mapping.merge import merge_drives
from automap.mapping.posts import with_supports
from automap.mapping.sightings import DriveSigns
from tests.unit.merge_scene import Errors, drive_through, street

PATH = np.array([[-1.5, -40.0], [-1.5, 340.0]])
CALM = Errors(clutter=0.0, missed=0.0, wrong_class=0.0)


def passes(count: int) -> list[DriveSigns]:
    """Drives through a street of signs 15 m apart."""
    rng = np.random.default_rng(11)
    town = street(rng, 300.0, 15.0)
    return [
        drive_through(rng, town, PATH, 12.0, f"d{k}", 1.45e9 + 86400.0 * k, CALM)[0]
        for k in range(count)
    ]


def test_two_faces_of_a_post_share_it_and_its_neighbours_do_not() -> None:
    merged = merge_drives(passes(3))
    signs = [replace(sign, id=f"s{k}") for k, sign in enumerate(merged.signs)]
    own = merged.own_variance
    alone = with_supports(signs, own)
    assert len({sign.support for sign in alone}) > 0.9 * len(signs)
    # the second sign hung below the first, the third left out of the map
    below = replace(signs[1], **{n: getattr(signs[0], n) for n in ("lat_rad", "lon_rad", "side")})
    below = replace(below, height_m=signs[0].height_m - 0.7)
    third = replace(signs[2], id="")
    found = with_supports([signs[0], below, third, *signs[3:]], own)
    assert found[0].support == found[1].support == "ps0"
    assert found[2].support == ""
    others = {sign.support for sign in found[3:]}
    assert "ps0" not in others
    assert np.array([sign.id for sign in found[3:]]).tolist() == [s.id for s in signs[3:]]


def test_a_sign_that_comes_changes_no_post_but_its_own() -> None:
    merged = merge_drives(passes(3))
    signs = [replace(sign, id=f"s{k}") for k, sign in enumerate(merged.signs)]
    own = merged.own_variance
    before = {sign.id: sign.support for sign in with_supports(signs[1:], own[1:])}
    after = {sign.id: sign.support for sign in with_supports(signs, own)}
    changed = [name for name, support in before.items() if after[name] != support]
    assert all(after[name] == after["s0"] for name in changed)


def test_a_map_without_signs_has_no_posts() -> None:
    assert with_supports([], np.zeros(0)) == []
