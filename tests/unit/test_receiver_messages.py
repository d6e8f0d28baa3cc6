"""Finding and decoding messages: against pyubx2 and pynmeagps, and in damaged streams."""

from __future__ import annotations

import datetime as dt

import numpy as np
import pynmeagps
import pytest
import pyubx2
from hypothesis import given, settings
from hypothesis import strategies as st
from receiver_messages import GPS, gga, message, pvt, rmc, sentence, ubx

from automap.io.byte_scan import key_address, scan_bytes
from automap.io.nmea import decode_nmea, unpack_text
from automap.io.ubx import decode_ubx, physical
from automap.io.ubx_layouts import LAYOUTS
from automap.io.ubx_names import MESSAGE_NAMES, message_name

FAST = settings(max_examples=25)


@pytest.mark.parametrize("name", sorted(LAYOUTS))
@FAST
@given(data=st.data())
def test_random_payloads_decode_as_pyubx2_decodes_them(name: str, data: st.DataObject) -> None:
    layout = LAYOUTS[name]
    payload = data.draw(st.binary(min_size=layout.size, max_size=layout.size))
    built = pyubx2.UBXMessage(name[:3], name, pyubx2.GET, parsebitfield=False, payload=payload)
    table = decode_ubx(built.serialize())[name]
    assert len(table) == 1
    seen = 0
    for field, kind, _ in layout.fields:
        theirs = getattr(built, field, None)
        if theirs is None or field.startswith("reserved"):
            continue
        seen += 1
        value = physical(name, table, field)[0]
        if name == "NAV-HPPOSLLH" and field in ("lat", "lon", "height", "hMSL"):
            # pyubx2 adds the high-precision part, heights in mm
            value += physical(name, table, field + "Hp")[0]
        if isinstance(theirs, bytes):
            theirs = int.from_bytes(theirs, "little")
        if kind == "f4" and np.isnan(theirs):
            assert np.isnan(value)
            continue
        # pyubx2 leaves most lengths and speeds in counts
        counts = float(table[field][0])
        hundredths = (value, counts, value * 1e3)
        assert any(theirs == pytest.approx(v, rel=1e-9, abs=1e-10) for v in hundredths), field
    assert seen >= len(layout.fields) - 6


def test_names_agree_with_pyubx2() -> None:
    known = {k: v for k, v in pyubx2.UBX_MSGIDS.items() if len(k) == 2 and k[0] in (1, 2, 16, 40)}
    for key, name in known.items():
        assert MESSAGE_NAMES[key[0] * 256 + key[1]] == name
    assert message_name(0x2799) == "UBX-0x27-0x99"


def test_the_old_short_pvt_is_read() -> None:
    whole = pvt(GPS)
    short = ubx(0x0107, whole[6 : 6 + 84])
    table = decode_ubx(short)["NAV-PVT"]
    assert table["lat"][0] == -350_000_000
    assert table["headVeh"][0] == 0
    assert "NAV-PVT" in decode_ubx(ubx(0x0107, whole[6 : 6 + 80]))
    assert len(decode_ubx(ubx(0x0107, whole[6 : 6 + 80]))["NAV-PVT"]) == 0


@FAST
@given(
    time=st.times(),
    lat=st.floats(0.0, 89.9),
    lon=st.floats(0.0, 179.9),
    height=st.floats(-400, 9000),
    side=st.sampled_from(["N", "S"]),
    status=st.sampled_from(["NF", "DR", "G2", "G3", "D2", "D3", "RK", "TT"]),
    figures=st.lists(st.floats(0, 99), min_size=8, max_size=8),
)
def test_pubx_round_trip(
    time: dt.time,
    lat: float,
    lon: float,
    height: float,
    side: str,
    status: str,
    figures: list[float],
) -> None:
    names = ("hAcc", "vAcc", "SOG", "COG", "vVel", "HDOP", "VDOP", "TDOP")
    values = {name: round(figure, 3) for name, figure in zip(names, figures, strict=True)}
    built = pynmeagps.NMEAMessage(
        "P",
        "UBX",
        pynmeagps.GET,
        msgId="00",
        time=time.replace(microsecond=time.microsecond // 10000 * 10000),
        lat=lat,
        NS=side,
        lon=lon,
        EW="W",
        altRef=round(height, 3),
        navStat=status,
        numSVs=7,
        reserved=0,
        DR=0,
        **values,
    )
    raw = built.serialize()
    read = pynmeagps.NMEAReader.parse(raw)
    table = decode_nmea(raw)["PUBX00"]
    for name, value in values.items():
        assert table[name][0] == value
    assert table["lat"][0] == pytest.approx(read.lat, abs=1e-9)
    assert table["lon"][0] == pytest.approx(read.lon, abs=1e-9)
    assert table["altRef"][0] == read.altRef
    assert unpack_text(table["navStat"][0]) == status
    assert table["numSVs"][0] == 7


@FAST
@given(st.decimals(-99999, 99999, places=6), st.sampled_from(["f", "+"]))
def test_numbers_are_read_as_the_language_reads_them(number: object, form: str) -> None:
    text = format(number, form if form == "f" else "f")
    table = decode_nmea(sentence(f"GPVTG,{text},T,,M,{text},N,,K,A"))["VTG"]
    assert table["cogt"][0] == float(text)


@pytest.mark.parametrize("text", ["", "-", ".", "1.2.3", "12a", "NaN", "--1"])
def test_what_is_no_number_is_nan(text: str) -> None:
    assert np.isnan(decode_nmea(sentence(f"GPVTG,{text},T,,M,,N,,K,A"))["VTG"]["cogt"][0])


@pytest.mark.parametrize(
    "place",
    ["9960.0000,N,00100.0,E", "4800.0,X,00100.0,E", "4800.0,N,99900.0,E", "-4800.0,N,x,E"],
)
def test_impossible_coordinates_are_nan(place: str) -> None:
    table = decode_nmea(sentence(f"GPGGA,120000,{place},1,08,0.9,1,M,2,M,,"))["GGA"]
    assert np.isnan(table["lat"][0]) or np.isnan(table["lon"][0])


def test_gsv_with_fewer_satellites_keeps_its_signal_id() -> None:
    table = decode_nmea(
        sentence("GPGSV,3,3,09,01,02,003,04,5")
        + sentence("GPGSV,1,1,02,01,02,003,04,11,12,013,14")
        + sentence("GPGSV,1,1,00,A")
    )["GSV"]
    assert table["signalID"].tolist()[::2] == [5, 10]
    assert np.isnan(table["signalID"][1])
    assert np.isnan(table["svid_2"][0])
    assert table["svid_2"][1] == 11


GOOD = [pvt(GPS), gga(GPS), rmc(GPS), message("NAV-EOE", iTOW=5), ubx(0x2799, b"$GPGGA,\xb5\x62")]


@FAST
@given(
    st.lists(
        st.one_of(
            st.sampled_from(GOOD),
            # bytes that cannot begin a message, and ones that can but do not
            st.binary(max_size=12).map(lambda b: b.translate(None, b"$\xb5\xd3#\r\n")),
            st.sampled_from([b"$", b"\xb5", b"\xb5\x62", b"\xb5\x62\x01\x07", b"$GPGGA,", b"$$"]),
        ),
        max_size=20,
    )
)
def test_every_message_between_garbage_is_found(parts: list[bytes]) -> None:
    # a good message follows, so that nothing counts as cut off
    stream = b"".join([*parts, GOOD[1]])
    scan = scan_bytes(stream)
    expected = sum(part in GOOD for part in parts) + 1
    assert len(scan) == expected
    total = int(scan.length.sum()) + scan.garbage_bytes + scan.comment_bytes
    assert total == len(stream)
    for offset, length in zip(scan.offset, scan.length, strict=True):
        assert stream[offset : offset + length] in GOOD


@FAST
@given(st.binary(max_size=400))
def test_any_bytes_are_accounted_for(data: bytes) -> None:
    scan = scan_bytes(data)
    total = int(scan.length.sum()) + scan.garbage_bytes + scan.comment_bytes
    assert total == (len(data) if scan.cut_offset < 0 else total)
    assert total <= len(data)


@pytest.mark.parametrize("whole", GOOD[:3])
def test_every_cut_is_reported(whole: bytes) -> None:
    for size in range(1, len(whole) - 2):
        scan = scan_bytes(GOOD[3] + whole[:size])
        assert len(scan) == 1
        assert scan.cut_offset == len(GOOD[3])
        assert scan.garbage_bytes == 0


def test_a_flipped_bit_costs_one_message() -> None:
    for at in range(2, len(GOOD[0])):
        damaged = bytearray(GOOD[0])
        damaged[at] ^= 0x10
        scan = scan_bytes(GOOD[1] + bytes(damaged) + GOOD[2] + GOOD[1])
        assert [key_address(k) for k in scan.keys if k > 0xFFFF] == ["GPGGA", "GPRMC"]
        assert len(scan) == 3


def test_lower_case_checksums_long_sentences_and_bare_line_ends() -> None:
    lower = sentence("GPVTG,0.05,T,,M,1.5,N,,K,A")
    star = lower.index(b"*")
    lower = lower[:star] + lower[star:].lower()
    long = sentence("GPTXT," + "x" * 300)
    scan = scan_bytes(lower + long.replace(b"\r\n", b"\n") + gga(GPS).rstrip() + pvt(GPS))
    assert len(scan) == 4
    assert scan.garbage_bytes == 0


def test_rtcm_frames_are_known() -> None:
    # 1005 of the RTCM 10403 standard's own example
    frame = bytes.fromhex("D300133ED7D30202980EDEEF34B4BD62AC0941986F33360B98")
    scan = scan_bytes(frame + pvt(GPS) + frame)
    assert len(scan) == 3
    assert scan.garbage_bytes == 0
    assert 0xD30000 + 1005 in scan.keys


def test_memory_does_not_grow_with_hostile_message_kinds() -> None:
    stream = b"".join(ubx(key, b"") for key in range(6000))
    scan = scan_bytes(stream)
    assert len(scan) == 6000
    assert len(scan.keys) <= 4096
