"""What a sign is called in a country, and the number on its face."""

from __future__ import annotations

import pytest

from automap.export.osm import sign_tags
from automap.export.osm_tags import traffic_sign_tags
from automap.export.sign_columns import sign_columns
from automap.signs.classes import load_classes
from automap.signs.codes import classes_of, face_of
from automap.signs.national import national_code, shown_value
from tests.unit.export_inputs import sign


@pytest.mark.parametrize(
    ("name", "country", "code"),
    [
        ("regulatory--maximum-speed-limit-50--g1", "AU", "AU:R4-1[50]"),
        ("regulatory--maximum-speed-limit-50--g1", "de", "DE:274-50"),
        # another variant of the same face
        ("regulatory--maximum-speed-limit-50--g3", "DE", "DE:274-50"),
        ("regulatory--maximum-speed-limit-50--g1", "US", "US:R2-1[50]"),
        ("warning--curve-left--g2", "US", "US:W1-2L"),
        # of the Vienna Convention where the country's is not known, and of its faces abroad
        ("regulatory--maximum-speed-limit-50--g1", "FR", "VIENNA:C14[50]"),
        ("information--hospital--g1", "AU", "VIENNA:E13A"),
        ("regulatory--keep-left--g1", "PL", "VIENNA:D2[L]"),
        ("regulatory--no-bicycles--g2", "PL", "VIENNA:C3C"),
        ("warning--crossroads--g1", "FR", "VIENNA:A18A"),
        ("warning--curve-left--g2", "PL", None),
        ("regulatory--maximum-speed-limit-50--g1", None, None),
        ("regulatory--maximum-speed-limit-50--g1", "no country", None),
        ("somebody's own class", "AU", None),
    ],
)
def test_the_code_is_that_of_the_country(name: str, country: str | None, code: str | None) -> None:
    assert national_code(name, country) == code


@pytest.mark.parametrize(
    ("name", "country", "value"),
    [
        ("regulatory--maximum-speed-limit-50--g1", "AU", (50.0, "km/h")),
        ("regulatory--maximum-speed-limit-110--g1", None, (110.0, "km/h")),
        ("regulatory--maximum-speed-limit-30--g1", "GB", (30.0, "mph")),
        ("regulatory--end-of-maximum-speed-limit-60--au", "AU", (60.0, "km/h")),
        ("warning--curve-left--g2", "AU", None),
        ("regulatory--stop--g1", "US", None),
    ],
)
def test_the_value_has_the_unit_of_the_country(
    name: str, country: str | None, value: tuple[float, str] | None
) -> None:
    assert shown_value(name, country) == value


def test_the_end_of_a_limit_is_none_on_the_map_of_roads() -> None:
    assert "maxspeed" not in traffic_sign_tags(
        "regulatory--end-of-maximum-speed-limit-60--au", "AU"
    )
    assert traffic_sign_tags("regulatory--maximum-speed-limit-60--g1", "AU")["maxspeed"] == "60"


def test_each_code_that_is_written_is_read_as_the_same_sign() -> None:
    for where in ("DE", "AU", "US", "FR"):
        told = {name: national_code(name, where) for name in load_classes()}
        codes = {name: code for name, code in told.items() if code}
        # a code says itself whose it is
        read = classes_of(list(codes.values()), "AU")
        same = [face_of(a) == face_of(b or "") for a, b in zip(codes, read, strict=True)]
        assert all(same), [c for c, ok in zip(codes.items(), same, strict=True) if not ok]
    assert len(codes) > 40


def test_the_map_of_roads_has_codes_of_countries_only() -> None:
    assert traffic_sign_tags("regulatory--keep-left--g1", "AU") == {"traffic_sign": "yes"}
    assert traffic_sign_tags("regulatory--stop--g1", "US")["traffic_sign"] == "US:R1-1"


def test_what_no_code_tells_a_mapper_the_fixme_does() -> None:
    names = ["regulatory--roundabout--g1", "warning--roundabout--g2"]
    columns = sign_columns([sign(k, class_name=name) for k, name in enumerate(names, 1)])
    blue, yellow = (sign_tags(columns, row, "AU") for row in (0, 1))
    assert blue["traffic_sign"] == "yes"
    assert blue["fixme"].startswith("check: roundabout (regulatory), ")
    assert yellow["traffic_sign"].startswith("AU:")
    assert yellow["fixme"].startswith("check: roundabout, ")


def test_columns_of_a_map_have_them() -> None:
    values = sign_columns([sign(1)], country="DE").values
    name = values["class"][0]
    assert values["code"] == [national_code(name, "DE")]
    shown = shown_value(name, "DE")
    assert (values["value_unit"][0] is None) == (shown is None)
