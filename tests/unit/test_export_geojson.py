"""signs.geojson against RFC 7946 and the contract."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from export_inputs import CLOCK, HOSTILE, sign
from geojson_pydantic import FeatureCollection
from hypothesis import given
from hypothesis import strategies as st

from automap.errors import InputError
from automap.export.geojson import longitude_range, read_signs_geojson, signs_geojson
from automap.export.sign_columns import ellipse_rings, sign_columns
from automap.records import NO_TIME, Sign

CONTRACT = [
    "id",
    "class",
    "confidence",
    "n_views",
    "first_seen",
    "last_seen",
    "height_above_road_m",
    "facing_deg",
    "facing_sd_deg",
    "size_m",
    "side",
    "cov_ee_m2",
    "cov_en_m2",
    "cov_nn_m2",
    "sd_u_m",
    "ce95_m",
    "drives",
    "status",
]


def parsed(signs: list[Sign], clock: bool = True) -> dict:  # type: ignore[type-arg]
    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is no JSON")

    text = signs_geojson(sign_columns(signs, CLOCK if clock else None))
    FeatureCollection.model_validate_json(text)
    return json.loads(text, parse_constant=refuse)


def test_properties_are_those_of_the_contract() -> None:
    content = parsed([sign(1), sign(2)])
    assert "crs" not in content
    feature = content["features"][0]
    # others may stand among them
    assert [name for name in feature["properties"] if name in CONTRACT] == CONTRACT
    assert feature["id"] == feature["properties"]["id"] == "s0001"
    lon, lat, height = feature["geometry"]["coordinates"]
    assert lon == pytest.approx(np.degrees(sign(1).lon_rad), abs=5.1e-8)
    assert lat == pytest.approx(np.degrees(sign(1).lat_rad), abs=5.1e-8)
    assert height == 159.0
    assert feature["properties"]["first_seen"] == "2026-03-14T01:20:07.000Z"
    assert feature["properties"]["facing_deg"] == pytest.approx(360 - np.degrees(0.5), abs=0.06)
    assert feature["properties"]["drives"] == "demo"
    west, south, low, east, north, high = content["bbox"]
    assert west <= lon <= east
    assert south <= lat <= north
    assert low <= height <= high


def test_unknown_values_are_null() -> None:
    nan = float("nan")
    unknown = sign(
        1,
        height_m=nan,
        cov_enu=np.full((3, 3), nan),
        facing_rad=nan,
        size_m=nan,
        confidence=nan,
        height_above_road_m=nan,
        first_seen_ns=NO_TIME,
        last_seen_ns=NO_TIME,
    )
    properties = parsed([unknown])["features"][0]["properties"]
    for name in ("confidence", "first_seen", "facing_deg", "cov_ee_m2", "sd_u_m", "ce95_m"):
        assert properties[name] is None, name
    assert len(parsed([unknown])["bbox"]) == 4


def test_no_clock_gives_host_stamps_and_no_position_a_null_geometry() -> None:
    lost = sign(2, lat_rad=float("nan"))
    content = parsed([sign(1), lost], clock=False)
    assert content["features"][0]["properties"]["first_seen"] == sign(1).first_seen_ns
    assert content["features"][1]["geometry"] is None
    assert "bbox" not in parsed([lost])
    assert parsed([])["features"] == []


def test_hostile_text_comes_back_unchanged(tmp_path: Path) -> None:
    hostile = sign(1, class_name=HOSTILE, id=HOSTILE, side=HOSTILE, drives=(HOSTILE, "b"))
    feature = parsed([hostile])["features"][0]
    assert feature["properties"]["class"] == HOSTILE
    assert feature["properties"]["drives"] == f"{HOSTILE}, b"
    surrogate = sign(1, drives=("caf\udce9",))
    signs_geojson(sign_columns([surrogate])).encode("utf-8")


@pytest.mark.filterwarnings("ignore:BBOX crossing")
def test_box_crosses_the_date_line_the_short_way() -> None:
    fiji = [sign(i, lon_rad=np.radians(lon)) for i, lon in enumerate((179.98, 180.0, -179.97), 1)]
    west, _, _, east, _, _ = parsed(fiji)["bbox"]
    assert (west, east) == (179.98, -179.97)
    turned = parsed([sign(1, lon_rad=np.radians(180.02))])
    assert turned["features"][0]["geometry"]["coordinates"][0] == pytest.approx(-179.98)


@given(st.lists(st.floats(-180, 180), min_size=1, max_size=8))
def test_longitude_range_holds_all(lon: list[float]) -> None:
    west, east = longitude_range(np.array(lon))
    width = (east - west) % 360.0
    for value in lon:
        assert (value - west) % 360.0 <= width + 1e-9 or value in (west, east)


def test_written_signs_are_read_back(tmp_path: Path) -> None:
    signs = [sign(i) for i in range(1, 30)]
    path = tmp_path / "signs.geojson"
    path.write_text(signs_geojson(sign_columns(signs, CLOCK)), encoding="utf-8")
    for before, after in zip(signs, read_signs_geojson(path, CLOCK), strict=True):
        assert (after.id, after.class_name, after.n_views) == (
            before.id,
            before.class_name,
            before.n_views,
        )
        assert after.lat_rad == pytest.approx(before.lat_rad, abs=1e-9)
        assert after.height_m == pytest.approx(before.height_m, abs=5e-4)
        np.testing.assert_allclose(after.cov_enu[:2, :2], before.cov_enu[:2, :2], rtol=1e-5)
        assert abs(after.first_seen_ns - before.first_seen_ns) <= 1_000_000
        assert (after.side, after.status, after.drives) == ("right", before.status, ("demo",))


def test_foreign_truth_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "truth.geojson"
    feature = {
        "type": "Feature",
        "id": "train-1",
        "geometry": {"type": "Point", "coordinates": [8.5, 49.0]},
        "properties": {"class": "stop", "sd_m": 0.7},
    }
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    (found,) = read_signs_geojson(path)
    assert found.id == "train-1"
    assert found.cov_enu[0, 0] == pytest.approx(0.49)
    assert np.isnan(found.height_m)
    assert found.first_seen_ns == NO_TIME


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "not readable"),
        ("[1]", "no features|FeatureCollection"),
        ('{"features": [{"geometry": {"type": "Polygon"}}]}', "feature 1.*Polygon"),
        ('{"features": [{"geometry": {"type": "Point", "coordinates": [1]}}]}', "feature 1"),
        ('{"features": [{"geometry": {"type": "Point", "coordinates": [1, 99]}}]}', "99"),
        ('{"features": [7]}', "feature 1"),
    ],
)
def test_broken_files_are_named(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "bad.geojson"
    path.write_text(text)
    with pytest.raises(InputError, match=words) as caught:
        read_signs_geojson(path)
    assert "bad.geojson" in str(caught.value)
    with pytest.raises(InputError, match="missing"):
        read_signs_geojson(tmp_path / "none.geojson")


def test_ellipse_ring_has_the_right_size_on_the_ground() -> None:
    east_sd = 3.0
    flat = sign(1, cov_enu=np.diag([east_sd**2, 1e-6, 1.0]), lat_rad=np.radians(60.0))
    ring = ellipse_rings(sign_columns([flat]))[0]
    from pymap3d.vincenty import vdist

    middle = np.degrees(flat.lon_rad)
    half, _ = vdist(60.0, middle, 60.0, ring[:, 0].max())
    # the ring lies at the sign's height, the distance on the ellipsoid
    assert float(half) == pytest.approx(east_sd * 2.4477, rel=1e-4)
