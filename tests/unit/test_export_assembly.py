"""Faces of a post from the top, and plates below their signs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from export_inputs import sign

from automap.export.assembly import on_post
from automap.export.sign_columns import sign_columns

PLATE = "complementary--distance--g1"


def test_faces_of_a_post_are_counted_from_the_top_on_each_side() -> None:
    low = replace(sign(1), id="a", support="p1", height_m=2.0, facing_rad=0.1)
    top = replace(low, id="b", height_m=3.0, facing_rad=6.2)
    back = replace(low, id="c", height_m=3.5, facing_rad=np.pi)
    other = replace(low, id="d", support="p2")
    loose = replace(low, id="e", support="")
    unknown = replace(low, id="f", height_m=np.nan)
    assert on_post([low, top, back, other, loose, unknown]).order == [2, 1, 1, 1, None, None]


def test_a_plate_belongs_to_the_nearest_sign_above_it() -> None:
    head = replace(sign(1), id="a", support="p1", height_m=3.0, facing_rad=1.0)
    second = replace(head, id="b", height_m=2.0)
    first_plate = replace(head, id="c", height_m=2.6, class_name=PLATE)
    plates = [
        replace(head, id=k, height_m=h, class_name=PLATE) for k, h in (("d", 1.6), ("e", 1.3))
    ]
    behind = replace(head, id="f", height_m=1.0, class_name=PLATE, facing_rad=1.0 + np.pi)
    signs = [*plates, head, first_plate, second, behind]
    hung = on_post(signs)
    assert hung.main == ["b", "b", None, "a", None, None]
    columns = sign_columns(signs)
    assert columns.values["main_sign"] == hung.main
    assert columns.values["face_order"] == hung.order == [4, 5, 1, 2, 3, 1]


def test_a_rectangle_that_nobody_could_read_is_a_plate_right_below_a_sign() -> None:
    square = "regulatory--unknown-white-square"
    head = replace(sign(1), id="a", support="p1", height_m=3.0, facing_rad=1.0, size_m=0.8)
    plate = replace(head, id="b", height_m=2.45, size_m=0.3, class_name=square)
    second = replace(plate, id="c", height_m=2.1)
    assert on_post([head, plate, second]).main == [None, "a", "a"]
    # apart it is a sign of its own, and so is a round one, or one that was read
    apart = replace(plate, id="d", height_m=1.6)
    read = replace(plate, class_name="information--parking--g1")
    round_one = replace(plate, class_name="regulatory--unknown-white-circle")
    for other in (apart, read, round_one):
        assert on_post([head, other]).main == [None, None]
    assert on_post([plate, second]).main == [None, None]
