"""Coordinates in other datums, against published examples."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymap3d import ecef2geodetic, geodetic2ecef

from automap.errors import ConfigError, InputError
from automap.export.datum import Datum, InDatum, decimal_year, is_moving, parse_datum, to_datum

CANBERRA = (149.13, -35.28)
MAS = np.pi / 180 / 3600 / 1000


def moved(
    text: str, place: tuple[float, float], recorded: float | None = 2026.2, **more: str
) -> InDatum:
    lon, lat = (np.array([value]) for value in place)
    return to_datum(lon, lat, np.array([50.0]), parse_datum(text), recorded, **more)


def shift_m(result: InDatum, place: tuple[float, float]) -> tuple[float, float]:
    """East and north."""
    east = (result.lon_deg[0] - place[0]) * 111320.0 * np.cos(np.radians(place[1]))
    return float(east), float((result.lat_deg[0] - place[1]) * 111133.0)


def test_the_manuals_example_of_itrf2014_to_gda2020() -> None:
    """GDA2020 Technical Manual 1.2, Alice Springs (ALIC) at 2018.0."""
    lat, lon, height = ecef2geodetic(-4052052.6588, 4212835.9938, -2545104.6946)
    result = to_datum(
        np.array([lon]),
        np.array([lat]),
        np.array([height]),
        parse_datum("GDA2020@2018.0"),
        None,
        frame="EPSG:7912",
    )
    xyz = np.ravel(geodetic2ecef(result.lat_deg, result.lon_deg, result.height_m))
    assert xyz == pytest.approx([-4052052.7373, 4212835.9835, -2545104.5867], abs=2e-4)


def test_australia_moves_seven_centimetres_a_year_to_the_north_north_east() -> None:
    """The manual's rotation rates, 1.50379, 1.18346, 1.20716 mas a year, by hand."""
    early, late = (moved(f"GDA2020@{year}", CANBERRA, None) for year in (2024.5, 2026.5))
    lon, lat = np.radians(CANBERRA[0]), np.radians(CANBERRA[1])
    rate = np.array([1.50379, 1.18346, 1.20716]) * MAS
    place = np.ravel(geodetic2ecef(CANBERRA[1], CANBERRA[0], 50.0))
    velocity = np.cross(rate, place)
    east = -np.sin(lon) * velocity[0] + np.cos(lon) * velocity[1]
    north = -np.sin(lat) * np.cos(lon) * velocity[0] - np.sin(lat) * np.sin(lon) * velocity[1]
    north += np.cos(lat) * velocity[2]
    first, second = shift_m(early, CANBERRA), shift_m(late, CANBERRA)
    assert (first[0] - second[0]) / 2 == pytest.approx(east, abs=1e-3)
    assert (first[1] - second[1]) / 2 == pytest.approx(north, abs=1e-3)
    assert 0.05 < np.hypot(east, north) < 0.075


@pytest.mark.parametrize(
    ("text", "place", "least", "most"),
    [
        ("GDA2020", CANBERRA, 0.3, 0.45),
        ("GDA94", CANBERRA, 1.7, 2.0),
        ("ETRS89", (13.4, 52.5), 0.8, 1.0),
        ("ETRF2000", (13.4, 52.5), 0.8, 1.0),
        ("NAD83(2011)", (-105.0, 40.0), 1.2, 1.7),
        ("ITRF2014", CANBERRA, 0.0, 0.02),
    ],
)
def test_shifts_are_of_the_known_size(
    text: str, place: tuple[float, float], least: float, most: float
) -> None:
    result = moved(text, place)
    assert least <= result.largest_shift_m <= most
    assert 0.0 <= result.accuracy_m <= 0.25


def test_wgs84_changes_nothing() -> None:
    result = moved("WGS84", CANBERRA, None)
    assert result.lon_deg[0] == CANBERRA[0]
    assert result.lat_deg[0] == CANBERRA[1]
    assert parse_datum("EPSG:4326").is_native


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("NAD83(2011)", CANBERRA, "made for"),
        ("EPSG:4267", (-105.0, 40.0), "no transformation"),
        ("SIRGAS2000", (-47.0, -15.0), "no transformation"),
        ("JGD2011", (139.7, 35.7), "no transformation"),
    ],
)
def test_what_cannot_be_done_well_is_refused(
    text: str, place: tuple[float, float], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        moved(text, place)


def test_a_null_transformation_is_refused() -> None:
    """PROJ offers "WGS 84 to GDA2020" as no shift at all, good to 3 m."""
    from pyproj.transformer import TransformerGroup

    offered = TransformerGroup("EPSG:4979", "EPSG:7843").transformers[0]
    assert offered.definition.startswith("proj=noop")
    with pytest.raises(InputError, match=r"takes both for the same|needs the grid"):
        moved("GDA2020@2026.5", CANBERRA, None, frame="EPSG:4979")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("GDA2021", "did you mean GDA2020"),
        ("GDA2020@later", "the year"),
        ("GDA2020@20.5", "the year"),
        ("EPSG:28355", "no longitude and latitude"),
        ("EPSG:999999", "no such code"),
        ("somewhere", "known are"),
    ],
)
def test_names_that_are_no_datum(text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        parse_datum(text)


def test_a_recording_without_a_date_needs_one() -> None:
    with pytest.raises(ConfigError, match="has no date"):
        moved("GDA2020", CANBERRA, None)
    assert moved("GDA2020@2026.5", CANBERRA, None).epoch == 2026.5


def test_an_epoch_that_is_not_the_recordings_is_said() -> None:
    assert moved("GDA2020@2020.0", CANBERRA).warnings
    assert not moved("GDA2020@2026.3", CANBERRA).warnings


def test_unknown_positions_and_heights_stay_unknown() -> None:
    lon, lat = np.array([149.0, np.nan]), np.array([-35.0, np.nan])
    result = to_datum(lon, lat, np.array([np.nan, 3.0]), Datum("GDA2020", "EPSG:7843"), 2026.0)
    assert np.isnan(result.lon_deg[1])
    assert np.isnan(result.height_m[0])
    assert result.lon_deg[0] != 149.0


@settings(max_examples=25)
@given(
    st.floats(114, 153),
    st.floats(-43, -12),
    st.floats(2010, 2040),
)
def test_gda2020_is_never_farther_off_than_the_plate_has_moved(
    lon: float, lat: float, year: float
) -> None:
    result = moved(f"GDA2020@{year}", (lon, lat), None)
    assert result.largest_shift_m < 0.08 * abs(year - 2020.0) + 0.01


def test_years() -> None:
    assert decimal_year(1457515219.0) == pytest.approx(2026.1983, abs=1e-3)
    assert is_moving("EPSG:7912")
    assert not is_moving("EPSG:7843")
