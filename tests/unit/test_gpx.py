"""GPX tracks as fixes."""

from __future__ import annotations

import numpy as np
import pytest

from automap.errors import InputError
from automap.io.receiver import ReceiverLog, read_receiver_bytes, sniff
from automap.records import FixType
from automap.timebase import gps_to_iso

PHONE = """<?xml version="1.0" encoding="UTF-8"?>
<!-- a phone's -->
<gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1"
 xmlns:t="http://www.garmin.com/xmlschemas/TrackPointExtension/v2">
<wpt lat="1" lon="1"><time>2026-03-14T09:00:00Z</time></wpt><trk>
<trkseg>{0}</trkseg><trkseg>{1}</trkseg></trk></gpx>"""


def point(second: int, lat: float = 48.1, more: str = "", zone: str = "Z") -> str:
    time = f"<time>2026-03-14T09:20:{second:02d}{zone}</time>" if zone != "none" else ""
    return f'<trkpt lat="{lat}" lon="11.5"><ele>520.5</ele>{time}{more}</trkpt>'


def read(*segments: str) -> ReceiverLog:
    return read_receiver_bytes(PHONE.format(*segments, *[""] * (2 - len(segments))).encode(), "a")


def test_points_of_all_segments_become_fixes() -> None:
    log = read(point(1) + point(2, 48.2), point(5))
    assert log.kind == "gpx"
    assert log.messages == {"GPX track point": 3}
    assert np.degrees(log.fixes.lat_rad).round(6).tolist() == [48.1, 48.2, 48.1]
    assert gps_to_iso(float(log.fixes.gps_s[2])) == "2026-03-14T09:20:05.000Z"
    assert log.fixes.height_m.tolist() == [520.5] * 3
    assert log.fixes.geoid_sep_m.tolist() == [0.0] * 3
    assert np.isnan(log.fixes.vel_ned).all()


def test_the_geoid_makes_heights_ellipsoidal() -> None:
    log = read(point(1, more="<geoidheight>46.0</geoidheight><sat>9</sat><hdop>0.8</hdop>"))
    assert log.fixes.height_m.tolist() == [566.5]
    assert log.fixes.n_sats.tolist() == [9]
    assert log.fixes.hdop.tolist() == [0.8]
    assert not log.warnings


def test_speed_and_course_of_extensions_are_velocities() -> None:
    inside = "<t:speed>10</t:speed><t:course>90</t:course>"
    more = f"<extensions><t:TrackPointExtension>{inside}</t:TrackPointExtension></extensions>"
    assert read(point(1, more=more)).fixes.vel_ned[0, :2] == pytest.approx([0.0, 10.0])


def test_a_zone_is_heeded_and_no_zone_is_utc() -> None:
    assert gps_to_iso(float(read(point(1, zone="+11:00")).fixes.gps_s[0])).startswith(
        "2026-03-13T22:20:01"
    )
    assert gps_to_iso(float(read(point(1, zone="")).fixes.gps_s[0])).startswith(
        "2026-03-14T09:20:01"
    )


def test_what_cannot_be_used_is_left_out_and_told() -> None:
    log = read(point(9) + point(10) + point(11, 99.0) + point(0, zone="none") + point(10))
    assert log.fixes.fix_type.tolist() == [FixType.THREE_D] * 2 + [FixType.NONE]
    told = " ".join(log.warnings)
    assert "1 track points without a time" in told
    assert "1 track points are left out" in told


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (PHONE.format(point(1, zone="none"), ""), "has a time, as in a planned route"),
        (PHONE.format("", ""), "none of its 0 track points"),
        (PHONE.format(point(1), "")[:-20], "is not whole as GPX"),
        ("<gpx><!DOCTYPE a [<!ENTITY b 'c'>]></gpx>", "it defines entities"),
    ],
)
def test_a_file_of_no_use_is_one_sentence(text: str, said: str) -> None:
    assert sniff(text.encode()) == "gpx"
    with pytest.raises(InputError, match=said) as caught:
        read_receiver_bytes(text.encode(), "a.gpx")
    assert "\n" not in str(caught.value)
