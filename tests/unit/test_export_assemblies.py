"""Posts and gantries with what hangs on them, from the top."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from export_inputs import CLOCK, sign

from automap.export.assemblies import ASSEMBLY_FIELDS, assemblies_geojson, assembly_layer
from automap.export.sign_columns import SignColumns, sign_columns

PLATE = "complementary--distance--g1"


def columns() -> SignColumns:
    """A post with a sign, its plate and one that looks back, and a gantry; a sign without place."""
    head = replace(sign(1), id="a", support="p1", height_m=163.0, height_above_road_m=3.0)
    plate = replace(head, id="b", height_m=162.4, height_above_road_m=2.4, class_name=PLATE)
    back = replace(
        sign(2),
        id="c",
        support="p1",
        height_m=162.0,
        height_above_road_m=2.0,
        facing_rad=head.facing_rad + np.pi,
        lat_rad=head.lat_rad,
        lon_rad=head.lon_rad,
    )
    gantry = [
        replace(sign(3), id=k, support="p2", side="overhead", height_m=float("nan"))
        for k in ("d", "e")
    ]  # fmt: skip
    lost = replace(sign(4), id="f", support="p3", lat_rad=float("nan"))
    return sign_columns([plate, back, head, *gantry, lost], CLOCK)


def test_faces_stand_from_the_top_and_plates_with_their_signs() -> None:
    layer = assembly_layer(columns())
    rows = {name: list(values) for name, values in layer.columns.items()}
    assert rows["id"] == ["p1", "p2"]
    assert rows["kind"] == ["post", "gantry"]
    assert rows["faces"] == ["a, b, c", "d, e"]
    assert rows["plates"] == ["b>a", None]
    assert rows["ways"] == [2, 1]
    assert rows["n_faces"] == [3, 2]
    assert rows["top_above_road_m"][0] == 3.0
    assert rows["first_seen"][0] < rows["last_seen"][0]
    assert set(rows) == {field.name for field in ASSEMBLY_FIELDS}


def test_each_face_has_its_height_and_way_and_a_seen_back_is_a_face() -> None:
    head = replace(sign(1), id="a", support="p1", height_m=163.0, height_above_road_m=3.0)
    head = replace(head, facing_rad=np.radians(300.0), n_back_views=4)
    low = replace(head, id="b", height_m=162.0, height_above_road_m=float("nan"), n_back_views=0)
    layer = assembly_layer(sign_columns([low, head], CLOCK))
    row = {name: values[0] for name, values in layer.columns.items()}
    assert row["faces"] == "a, a/back, b"
    assert row["classes"].split(", ")[1] == "back"
    assert row["heights_m"] == "3.00, 3.00, ?"
    assert row["facings_deg"] == "300, 120, 300"
    assert (row["n_faces"], row["ways"]) == (3, 2)


def test_a_post_stands_at_the_mean_of_its_signs_the_better_known_more() -> None:
    near = replace(sign(1), id="a", support="p1", cov_enu=np.eye(3) * 0.25)
    far = replace(near, id="b", cov_enu=np.eye(3), lat_rad=near.lat_rad + 1e-6)
    (wkb,) = assembly_layer(sign_columns([near, far])).wkb
    point = shapely.from_wkb(wkb)
    assert np.radians(point.y) - near.lat_rad == pytest.approx(0.2e-6, rel=1e-3)
    east, west = replace(near, lon_rad=np.pi - 1e-8), replace(far, lon_rad=1e-8 - np.pi)
    (wkb,) = assembly_layer(sign_columns([east, west])).wkb
    assert abs(abs(shapely.from_wkb(wkb).x) - 180.0) < 1e-6


def test_the_collection_has_the_same_and_may_be_empty() -> None:
    content = json.loads(assemblies_geojson(columns()))
    first, second = content["features"]
    assert first["properties"]["faces"] == "a, b, c"
    assert first["properties"]["first_seen"].endswith("Z")
    assert len(first["geometry"]["coordinates"]) == 3
    assert len(second["geometry"]["coordinates"]) == 2
    assert json.loads(assemblies_geojson(sign_columns([])))["features"] == []


def test_no_post_costs_a_look_at_all_signs() -> None:
    """A map of half a million signs has as many posts."""
    asked: list[str] = []

    class Noted(dict[str, Any]):
        def __getitem__(self, name: str) -> Any:
            asked.append(name)
            return super().__getitem__(name)

    signs = [replace(sign(1), id=f"s{k}", support=f"p{k}") for k in range(30)]
    columns = sign_columns(signs, CLOCK)
    noted = replace(columns, values=Noted(columns.values))
    assert len(assembly_layer(noted)) == 30
    assert asked.count("cov_ee_m2") == asked.count("cov_nn_m2") == 1
