"""Which road a path went along, and where on it its signs stand."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import shapely
from merge_scene import to_geodetic
from pyogrio.raw import write
from pyproj import CRS, Transformer

from automap.errors import InputError
from automap.export.roads import read_roads_csv, road_rows, roads_csv
from automap.io.roads_file import read_roads
from automap.records import DrivePath, FloatArray, Roads, Sign
from automap.roads.matching import road_positions

EVERYWHERE = (-180.0, -90.0, 180.0, 90.0)


def degrees(xy: FloatArray) -> FloatArray:
    lat, lon, _ = to_geodetic(np.column_stack([xy, np.zeros(len(xy))]))
    return np.degrees(np.column_stack([lon, lat]))


def layer(*lines: list[tuple[float, float]]) -> Roads:
    names = [f"r{k}" for k in range(len(lines))]
    parts = [degrees(np.array(line, np.float64)) for line in lines]
    return Roads(parts, names, names, np.zeros(len(lines)))


def driven(corners: list[tuple[float, float]], error: FloatArray | None = None) -> DrivePath:
    """A drive at 10 m/s with a place every second."""
    line = np.array(corners, np.float64)
    size = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    at = np.arange(0.0, size[-1], 10.0)
    xy = np.column_stack([np.interp(at, size, line[:, k]) for k in range(2)])
    yaw = np.arctan2(*np.gradient(xy, axis=0).T)
    lat, lon, _ = to_geodetic(
        np.column_stack([xy if error is None else xy + error, np.zeros(len(xy))])
    )
    return DrivePath(at / 10.0, lat, lon, yaw, np.full((len(at), 3), 1.0))


def sign_at(east: float, north: float, facing: float, side: str = "") -> Sign:
    lat, lon, _ = to_geodetic(np.array([[east, north, 2.0]]))
    return Sign(
        "s1", "regulatory--stop--g1", lat[0], lon[0], 580.0, np.eye(3), 0.9, 5, 0, 0, 2.0, facing,
        0.6, side,
    )  # fmt: skip


UNKNOWN = (np.nan, np.nan)


@pytest.mark.parametrize("against", [False, True])
@pytest.mark.parametrize("east", [6.0, -6.0])
def test_chainage_offset_side_and_direction(against: bool, east: float) -> None:
    line = [(0.0, 0.0), (0.0, 400.0)]
    roads = layer(line[::-1] if against else line)
    # driven to the north: the face looks south
    (found,), _ = road_positions(
        driven([(2.0, 0.0), (2.0, 400.0)]), roads, [sign_at(east, 130.0, np.pi)], [UNKNOWN]
    )
    assert found is not None
    assert found.chainage_m == pytest.approx(270.0 if against else 130.0, abs=0.3)
    right = (east > 0.0) != against
    assert found.offset_m == pytest.approx(6.0 if right else -6.0, abs=0.1)
    assert found.side == ("right" if right else "left")
    assert found.direction == ("backward" if against else "forward")
    # seen from behind it speaks to those who come
    back = sign_at(east, 130.0, 0.0)
    (other,), _ = road_positions(driven([(2.0, 0.0), (2.0, 400.0)]), roads, [back], [UNKNOWN])
    assert other is not None
    assert other.direction == ("forward" if against else "backward")


def test_the_road_that_goes_on_wins_over_a_nearer_one_that_does_not() -> None:
    """A parallel road lies on the path for a while, and is not connected to where it goes."""
    roads = layer(
        [(0.0, 0.0), (0.0, 500.0), (300.0, 500.0)],
        [(9.0, 100.0), (9.0, 400.0)],
        [(-200.0, 250.0), (200.0, 250.0)],
    )
    # some metres off, nearer to the second road half of the way
    error = np.tile([6.0, 0.0], (80, 1))
    path = driven([(0.0, 0.0), (0.0, 500.0), (300.0, 500.0)], error)
    _, matched = road_positions(path, roads, [], [])
    # the first two segments are the first road's
    assert np.isin(matched.segment, [0, 1]).mean() > 0.95


def test_a_sign_that_the_drive_passed_twice_stands_on_the_road_it_was_seen_from() -> None:
    roads = layer([(0.0, 0.0), (0.0, 300.0)], [(0.0, 300.0), (20.0, 300.0)],
                  [(20.0, 300.0), (20.0, 0.0)])  # fmt: skip
    path = driven([(0.0, 0.0), (0.0, 300.0), (20.0, 300.0), (20.0, 0.0)])
    sign = sign_at(10.0, 150.0, np.pi)
    (up, down), _ = road_positions(path, roads, [sign, sign], [(8.0, 14.0), (40.0, 46.0)])
    assert up is not None
    assert down is not None
    assert (up.road, down.road) == (0, 2)


@pytest.mark.parametrize(("east", "facing", "side"), [
    (-6.0, 3.0, "left"), (6.0, 3.0, "right"), (-6.0, 0.2, "right"), (6.0, 0.2, "left"),
])  # fmt: skip
def test_a_street_driven_both_ways_has_its_signs_on_the_side_they_were_read_from(
    east: float, facing: float, side: str
) -> None:
    """When it was seen is not known, as in maps of very many drives; ``side`` is that of a car that
    reads it, which may have come back on the sign's side."""
    path = driven([(3.0, 0.0), (3.0, 400.0), (-3.0, 400.0), (-3.0, 0.0)])
    roads = layer([(0.0, 0.0), (0.0, 400.0)])
    (at,), _ = road_positions(path, roads, [sign_at(east, 150.0, facing, side)], [UNKNOWN])
    assert at is not None
    assert at.side == ("right" if east > 0.0 else "left")
    assert at.direction == ("forward" if facing > 1.0 else "backward")


def test_no_place_far_from_every_road() -> None:
    roads = layer([(900.0, 0.0), (900.0, 400.0)])
    path = driven([(0.0, 0.0), (0.0, 400.0)])
    (found,), matched = road_positions(path, roads, [sign_at(5.0, 100.0, np.pi)], [UNKNOWN])
    assert found is None
    assert (matched.segment == -1).all()


OSM = """<osm version="0.6">
<node id="1" lat="-35.28" lon="149.13" version="1"/>
<node id="2" lat="-35.27" lon="149.13" version="1"/>
<node id="3" lat="-35.27" lon="149.14" version="1"/>
<way id="70" version="1"><nd ref="1"/><nd ref="2"/><tag k="highway" v="primary"/>
<tag k="name" v="Main"/></way>
<way id="71" version="1"><nd ref="2"/><nd ref="3"/><tag k="highway" v="footway"/></way>
</osm>"""


def test_an_extract_of_openstreetmap_gives_roads_for_cars(tmp_path: Path) -> None:
    path = tmp_path / "town.osm"
    path.write_text(OSM, encoding="utf-8")
    roads = read_roads(path, EVERYWHERE)
    assert (roads.ids, roads.names) == (["70"], ["Main"])
    assert roads.lines[0] == pytest.approx(np.array([[149.13, -35.28], [149.13, -35.27]]))


def varint(number: int) -> bytes:
    """A whole number as protocol buffers have it, seven bits a byte."""
    text = bytearray()
    while number > 0x7F:
        text.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*text, number])


def zigzag(number: int) -> int:
    return 2 * number if number >= 0 else -2 * number - 1


def message(*fields: tuple[int, int | bytes]) -> bytes:
    """A message of protocol buffers: numbers, and bytes with their length."""
    return b"".join(
        varint(key << 3) + varint(value)
        if isinstance(value, int)
        else varint(key << 3 | 2) + varint(len(value)) + value
        for key, value in fields
    )


def packed(*numbers: int) -> bytes:
    return b"".join(varint(number) for number in numbers)


def osm_pbf() -> bytes:
    """The extract ``OSM`` above as .osm.pbf (wiki.openstreetmap.org/wiki/PBF_Format)."""
    texts = [b"", b"highway", b"primary", b"name", b"Main", b"footway"]
    places = [(1, -35.28, 149.13), (2, -35.27, 149.13), (3, -35.27, 149.14)]
    nodes = [
        (1, message((1, zigzag(n)), (8, zigzag(round(lat * 1e7))), (9, zigzag(round(lon * 1e7)))))
        for n, lat, lon in places
    ]
    main = message((1, 70), (2, packed(1, 3)), (3, packed(2, 4)), (8, packed(2, 2)))
    foot = message((1, 71), (2, packed(1)), (3, packed(5)), (8, packed(4, 2)))
    table = message(*((1, text) for text in texts))
    data = message((1, table), (2, message(*nodes)), (2, message((3, main), (3, foot))))
    blocks = ((b"OSMHeader", message((4, b"OsmSchema-V0.6"))), (b"OSMData", data))
    parts = []
    for kind, content in blocks:
        blob = message((1, content))
        head = message((1, kind), (3, len(blob)))
        parts.append(len(head).to_bytes(4, "big") + head + blob)
    return b"".join(parts)


def test_a_packed_extract_of_openstreetmap_is_read_alike(tmp_path: Path) -> None:
    packed_file, plain = tmp_path / "town.osm.pbf", tmp_path / "town.osm"
    packed_file.write_bytes(osm_pbf())
    plain.write_text(OSM, encoding="utf-8")
    found, expected = read_roads(packed_file, EVERYWHERE), read_roads(plain, EVERYWHERE)
    assert (found.ids, found.names) == (expected.ids, expected.names) == (["70"], ["Main"])
    assert found.lines[0] == pytest.approx(expected.lines[0], abs=1e-7)
    packed_file.write_bytes(osm_pbf()[:90])
    with pytest.raises(InputError, match=r"town\.osm\.pbf"):
        read_roads(packed_file, EVERYWHERE)


@pytest.mark.parametrize("form", ["gpkg", "geojson", "shp"])
def test_other_layers_count_from_where_they_say(tmp_path: Path, form: str) -> None:
    path = tmp_path / f"roads.{form}"
    line = shapely.linestrings([(149.13, -35.28), (149.13, -35.27)])
    driver = {"gpkg": "GPKG", "geojson": "GeoJSON", "shp": "ESRI Shapefile"}[form]
    fields = [np.array(["A1"], object), np.array([1250.0])]
    write(path, geometry=np.array([shapely.to_wkb(line)], object), field_data=fields,
          fields=["road_id", "from_m"], driver=driver, geometry_type="LineString",
          crs="EPSG:4326")  # fmt: skip
    roads = read_roads(path, EVERYWHERE)
    assert roads.ids == ["A1"]
    assert roads.start_m.tolist() == [1250.0]
    assert roads.unread == ()
    with pytest.raises(InputError, match="where the drive went"):
        read_roads(path, (7.0, 50.0, 8.0, 51.0))


def test_a_layer_whose_keys_are_not_known_has_rows(tmp_path: Path) -> None:
    path = tmp_path / "roads.geojson"
    line = {"type": "LineString", "coordinates": [[149.13, -35.28], [149.13, -35.27]]}
    feature = {"type": "Feature", "properties": {"WHAT": "R7", "LEN": 3}, "geometry": line}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    roads = read_roads(path, EVERYWHERE)
    assert roads.ids == ["row 1"]
    assert set(roads.unread) == {"WHAT", "LEN"}


def test_points_are_no_roads(tmp_path: Path) -> None:
    path = tmp_path / "points.geojson"
    point = {
        "type": "Feature",
        "properties": {},
        "geometry": {"type": "Point", "coordinates": [1, 2]},
    }
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [point]}))
    with pytest.raises(InputError, match="holds no lines"):
        read_roads(path, EVERYWHERE)


def test_the_table_is_read_as_it_was_written(tmp_path: Path) -> None:
    roads = replace(layer([(0.0, 0.0), (0.0, 400.0)]), names=["=1+1"])
    sign = sign_at(6.0, 130.0, np.pi)
    found, _ = road_positions(driven([(2.0, 0.0), (2.0, 400.0)]), roads, [sign], [UNKNOWN])
    rows = road_rows([sign], found, roads)
    path = tmp_path / "sign_roads.csv"
    path.write_text(roads_csv(rows), encoding="utf-8", newline="")
    assert "'=1+1" in path.read_text(encoding="utf-8")
    (again,) = read_roads_csv(path)
    for name, cell in rows[0].items():
        if name.endswith(("_m", "_deg")):
            assert float(again[name]) == float(cell)
        else:
            assert again[name] == cell
    spoilt = roads_csv(rows).replace(rows[0]["chainage_m"], "x")
    path.write_text(spoilt, encoding="utf-8", newline="")
    with pytest.raises(InputError, match="no table of signs on roads"):
        read_roads_csv(path)


def test_kinds_and_one_way_roads_are_read(tmp_path: Path) -> None:
    """Of OpenStreetMap's tags, what a motorway need not say included, and of other layers."""
    way = '<way id="{}" version="1"><nd ref="1"/><nd ref="2"/>{}</way>'
    tags = (
        (("highway", "motorway"), ("ref", "A 7")),
        (("highway", "primary"), ("oneway", "-1")),
        (("highway", "primary"), ("oneway", "no"), ("name", "Main")),
        (("highway", "tertiary"), ("junction", "roundabout")),
    )
    ways = "".join(
        way.format(80 + k, "".join(f'<tag k="{key}" v="{value}"/>' for key, value in own))
        for k, own in enumerate(tags)
    )
    path = tmp_path / "ways.osm"
    path.write_text(OSM.replace("</osm>", f"{ways}</osm>"), encoding="utf-8")
    roads = read_roads(path, EVERYWHERE)
    told = {
        i: (roads.kind(k), int(roads.oneway[k]), roads.names[k]) for k, i in enumerate(roads.ids)
    }
    assert told == {
        "70": ("primary", 0, "Main"),
        "80": ("motorway", 1, "A 7"),
        "81": ("primary", -1, ""),
        "82": ("primary", 0, "Main"),
        "83": ("tertiary", 1, ""),
    }
    line = {"type": "LineString", "coordinates": [[149.13, -35.28], [149.13, -35.27]]}
    features = [
        {"type": "Feature", "properties": {"id": "1", "fclass": "trunk", "oneway": word},
         "geometry": line}
        for word in ("F", "T", "B")
    ]  # fmt: skip
    other = tmp_path / "layer.geojson"
    other.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    roads = read_roads(other, EVERYWHERE)
    assert roads.kinds == ["trunk"] * 3
    assert roads.oneway.tolist() == [1, -1, 0]


@pytest.mark.parametrize("crs", ["OGC:CRS84", "EPSG:7855", None])
def test_roads_are_read_from_geoparquet(crs: str | None, tmp_path: Path) -> None:
    """As GeoPandas and QGIS write it: WKB lines, the system as PROJJSON, or none where it is
    longitude and latitude."""
    lines = [degrees(np.array([(0.0, 0.0), (0.0, 100.0), (0.0, 300.0)])),
             degrees(np.array([(10.0, 0.0), (400.0, 0.0)]))]  # fmt: skip
    written = [line.copy() for line in lines]
    if crs == "EPSG:7855":
        flat = Transformer.from_crs("OGC:CRS84", crs, always_xy=True)
        written = [np.column_stack(flat.transform(*line.T)) for line in lines]
    about: dict[str, object] = {"encoding": "WKB", "geometry_types": ["LineString"]}
    if crs is not None:
        about["crs"] = CRS.from_user_input(crs).to_json_dict()
    geo = {"version": "1.1.0", "primary_column": "geom", "columns": {"geom": about}}
    table = pa.table(
        {
            "gid": [17, 18],
            "name": ["North St", "East St"],
            "highway": ["residential", "footway"],
            "start_m": [250.0, 0.0],
            "geom": pa.array(shapely.to_wkb([shapely.LineString(line) for line in written])),
        }
    )
    path = tmp_path / "roads.parquet"
    pq.write_table(table.replace_schema_metadata({"geo": json.dumps(geo)}), path)
    roads = read_roads(path, EVERYWHERE)
    assert (roads.ids, roads.names, roads.kinds) == (["17"], ["North St"], ["residential"])
    assert roads.start_m.tolist() == [250.0]
    assert roads.lines[0] == pytest.approx(lines[0], abs=2e-8)
