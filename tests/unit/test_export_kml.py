"""map.kml against the schemas of OGC and of Google's extensions."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from export_inputs import CLOCK, HOSTILE, sign, trajectory
from lxml import etree

from automap.export.kml import class_colours, map_kml
from automap.export.path import simplified_path
from automap.export.sign_columns import sign_columns
from automap.records import NO_TIME

KML = "{http://www.opengis.net/kml/2.2}"
GX = "{http://www.google.com/kml/ext/2.2}"

DOCUMENTS = ("full", "no clock", "no geoid", "empty", "signs only", "path only", "hostile", "odd")


@pytest.fixture(scope="module")
def schema() -> etree.XMLSchema:
    found = find_spec("fastkml")
    if found is None or found.origin is None:
        pytest.skip("the KML schemas come with the package fastkml, which is not installed")
    return etree.XMLSchema(etree.parse(Path(found.origin).parent / "schema" / "ogckml22.xsd"))


def document(kind: str) -> str:
    signs = [sign(i) for i in range(1, 9)]
    path = simplified_path(trajectory())
    clock = CLOCK
    if kind == "no clock":
        return map_kml("x", sign_columns(signs), simplified_path(trajectory(clock=False)))
    if kind == "no geoid":
        return map_kml("x", sign_columns(signs, clock), path)
    if kind == "empty":
        return map_kml("x", sign_columns([]), None)
    if kind == "signs only":
        return map_kml("x", sign_columns(signs, clock), None, np.full(8, 40.0))
    if kind == "path only":
        return map_kml("x", sign_columns([]), path, None, np.full(len(path), 40.0))
    if kind == "hostile":
        bad = [sign(i, id=HOSTILE, class_name=f"{HOSTILE}{i}", side=HOSTILE) for i in range(3)]
        return map_kml(HOSTILE, sign_columns(bad, clock), path)
    if kind == "odd":
        nan = float("nan")
        odd = [
            sign(1, lat_rad=nan),
            sign(2, height_m=nan, first_seen_ns=NO_TIME, cov_enu=np.full((3, 3), nan)),
            sign(3, lon_rad=np.pi - 1e-8),
        ]
        return map_kml("x", sign_columns(odd, clock), path, np.array([40.0, nan, 40.0]))
    return map_kml(
        "x", sign_columns(signs, clock), path, np.full(8, 48.0), np.full(len(path), 48.0)
    )


@pytest.mark.parametrize("kind", DOCUMENTS)
def test_valid_against_the_schema(schema: etree.XMLSchema, kind: str) -> None:
    schema.assertValid(etree.fromstring(document(kind).encode()))


@pytest.mark.parametrize("kind", DOCUMENTS)
def test_nothing_refers_to_the_network(kind: str) -> None:
    root = etree.fromstring(document(kind).encode())
    assert not root.findall(f".//{KML}href")
    texts = [text for text in root.itertext() if "http" in text]
    assert texts == []


def test_altitudes_are_above_the_sea() -> None:
    root = etree.fromstring(document("full").encode())
    point = root.find(f".//{KML}Point")
    assert point.findtext(f"{KML}altitudeMode") == "absolute"
    altitude = float(point.findtext(f"{KML}coordinates").split(",")[2])
    assert altitude == pytest.approx(sign(1).height_m - 48.0, abs=0.01)
    coords = [tuple(map(float, e.text.split())) for e in root.iter(f"{GX}coord")]
    assert 105.0 < np.mean([c[2] for c in coords]) < 115.0


def test_without_the_geoid_everything_lies_on_the_ground() -> None:
    root = etree.fromstring(document("no geoid").encode())
    modes = {element.text for element in root.iter(f"{KML}altitudeMode")}
    assert modes == {"clampToGround"}


def test_track_has_a_time_a_place_and_angles_for_every_point() -> None:
    root = etree.fromstring(document("full").encode())
    track = root.find(f".//{GX}Track")
    whens = [e.text for e in track.iter(f"{KML}when")]
    angles = [tuple(map(float, e.text.split())) for e in track.iter(f"{GX}angles")]
    assert len(whens) == len(angles) == len(list(track.iter(f"{GX}coord"))) > 10
    assert whens == sorted(whens)
    assert whens[0] == "2026-03-14T01:20:00.000Z"
    assert all(0 <= heading < 360 and abs(tilt) < 2 for heading, tilt, _ in angles)


def test_no_clock_gives_a_line_without_times() -> None:
    root = etree.fromstring(document("no clock").encode())
    assert root.find(f".//{GX}Track") is None
    assert root.find(f".//{KML}LineString") is not None


def test_hostile_text_stays_text() -> None:
    root = etree.fromstring(document("hostile").encode())
    placemark = root.find(f".//{KML}Placemark")
    shown = HOSTILE.replace("\x07", "\ufffd")
    assert placemark.findtext(f"{KML}name") == shown
    balloon = placemark.findtext(f"{KML}description")
    assert "<img" not in balloon
    assert "<script" not in balloon
    assert "$[" not in balloon, "a value must not name another field of the balloon"
    assert "&lt;img" in balloon


def test_ring_on_the_date_line_becomes_two_polygons() -> None:
    root = etree.fromstring(document("odd").encode())
    shapes = root.findall(f".//{KML}MultiGeometry")
    assert [len(shape) for shape in shapes] == [2]
    for element in root.iter(f"{KML}coordinates"):
        for corner in element.text.split():
            assert abs(float(corner.split(",")[0])) <= 180.0


def test_class_colours_do_not_depend_on_order() -> None:
    assert class_colours(["b", "a", "b"]) == class_colours(["a", "b"])
    assert len(set(class_colours(["a", "b", "c"]).values())) == 3
