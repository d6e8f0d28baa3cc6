"""What a sign is called in a country, and the number on its face."""

from __future__ import annotations

import pytest

from automap.export.osm_tags import traffic_sign_tags
from automap.export.sign_columns import sign_columns
from automap.signs.national import national_code, shown_value
from tests.unit.export_inputs import sign


@pytest.mark.parametrize(
    ("name", "country", "code"),
    [
        ("regulatory--maximum-speed-limit-50--g1", "AU", "AU:R4-1[50]"),
        ("regulatory--maximum-speed-limit-50--g1", "de", "DE:274-50"),
        # another variant of the same face
        ("regulatory--maximum-speed-limit-50--g3", "DE", "DE:274-50"),
        ("regulatory--maximum-speed-limit-50--g1", "FR", None),
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


def test_columns_of_a_map_have_them() -> None:
    values = sign_columns([sign(1)], country="DE").values
    name = values["class"][0]
    assert values["code"] == [national_code(name, "DE")]
    shown = shown_value(name, "DE")
    assert (values["value_unit"][0] is None) == (shown is None)
