"""Messages and inertial samples out of a stream, however it is cut into pieces."""

from __future__ import annotations

import struct
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from automap.errors import ConfigError
from pipeline.record.checksums import CHECKSUMS
from pipeline.record.imu_decode import ImuDecoder, Sample
from pipeline.record.imu_format import ImuFormat, known_formats, load_format, read_format
from pipeline.record.messages import Message, MessageStream, ubx_frame
from tests.unit.simulated_receiver import nav_pvt

GGA = b"$GNGGA,092000.00,3516.80,S,14907.80,E,1,12,0.80,560.0,M,20.0,M,,*5A\r\n"


def _gga() -> bytes:
    body = GGA[1 : GGA.index(b"*")]
    value = 0
    for byte in body:
        value ^= byte
    return b"$" + body + b"*%02X\r\n" % value


def _cut(data: bytes, cuts: list[int]) -> list[bytes]:
    places = sorted({min(cut, len(data)) for cut in cuts} | {0, len(data)})
    return [data[a:b] for a, b in pairwise(places)]


@given(st.lists(st.integers(0, 700), max_size=12))
@settings(max_examples=60)
def test_pieces_do_not_matter_to_messages(cuts: list[int]) -> None:
    noise = b"\xb5\x62\x01\x07\x00garbage$GP\xb5"
    data = nav_pvt(1000) + noise + _gga() + b"\r\n" + nav_pvt(2000) + ubx_frame(0x0A04, b"x" * 40)
    whole = MessageStream()
    expected = [(m.key, m.payload) for m in whole.feed(0, data)]
    assert [key for key, _ in expected] == [0x0107, 0, 0x0107, 0x0A04]
    stream = MessageStream()
    found: list[Message] = []
    for number, piece in enumerate(_cut(data, cuts)):
        found += stream.feed(number, piece)
    assert [(m.key, m.payload) for m in found] == expected
    assert stream.stray_bytes == whole.stray_bytes == len(noise)


def test_a_message_bears_the_time_of_its_first_byte() -> None:
    stream = MessageStream()
    first, second = nav_pvt(1000), nav_pvt(2000)
    assert stream.feed(10, first[:30]) == []
    found = stream.feed(20, first[30:] + second[:5]) + stream.feed(30, second[5:])
    assert [m.t_ns for m in found] == [10, 20]


def test_after_an_interruption_nothing_is_glued_together() -> None:
    stream = MessageStream()
    stream.feed(0, nav_pvt(1000)[:50])
    stream.restart()
    assert len(stream.feed(1, nav_pvt(2000))) == 1


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("crc16-ccitt", 0x29B1), ("crc16-xmodem", 0x31C3), ("crc16-modbus", 0x4B37),
        ("crc32", 0xCBF43926), ("xor8", 0x31), ("sum8", 0xDD), ("sum16", 0x1DD),
        ("negative-sum8", 0x23),
    ],
)  # fmt: skip
def test_checksums_have_their_published_check_values(name: str, value: int) -> None:
    assert CHECKSUMS[name][1](b"123456789") == value


@pytest.mark.parametrize("name", known_formats())
def test_formats_that_come_along_decode_what_they_describe(name: str) -> None:
    form = load_format(name)
    readings = {"gx": 11, "gy": -12, "gz": 13, "ax": 14, "ay": -15, "az": 16}
    if "thinimu" in name:
        readings = {key: abs(value) + 2000 for key, value in readings.items()}
    values = [readings.get(column, 7) for column in form.columns]
    data = b"".join(encode(form, values) for _ in range(3))
    found = ImuDecoder(form).feed(5, data)
    assert len(found) == 3
    assert found[0].values[:6] == tuple(readings.values())
    assert (found[0].device_ns is not None) == form.has_clock


def encode(form: ImuFormat, values: list[int]) -> bytes:
    """A line or frame of a format."""
    if form.text:
        line = form.prefix + form.separator.join(map(str, values))
        if form.checksum == "nmea":
            check = 0
            for byte in line.lstrip("$").encode():
                check ^= byte
            line += f"*{check:02X}"
        return line.encode() + b"\r\n"
    assert form.layout is not None
    body = form.sync + form.layout.pack(*values)
    if form.checksum is None:
        return body
    size, function = CHECKSUMS[form.checksum]
    order = "big" if form.layout.format[0] == ">" else "little"
    return body + function(body[form.checksum_from :]).to_bytes(size, order)  # type: ignore[arg-type]


FRAME = load_format("mpu9150-frame")


@given(st.lists(st.integers(0, 600), max_size=12), st.binary(max_size=40))
@settings(max_examples=60)
def test_pieces_and_noise_do_not_matter_to_frames(cuts: list[int], noise: bytes) -> None:
    noise = noise.replace(b"\xaa", b"\x11").replace(b"\x55", b"\x11")
    frames = [encode(FRAME, [1000 * i, i, 2, 3, 4, 5, 6, 7]) for i in range(20)]
    data = noise + b"".join(frames[:10]) + noise + b"".join(frames[10:])
    decoder = ImuDecoder(FRAME)
    found: list[Sample] = []
    for number, piece in enumerate(_cut(data, cuts)):
        found += decoder.feed(number, piece)
    assert [sample.values[3] for sample in found] == list(range(20))
    assert [sample.device_ns for sample in found] == [1_000_000 * i for i in range(20)]
    assert decoder.bad == 0


def test_a_damaged_frame_is_counted_and_the_next_one_found() -> None:
    frames = [encode(FRAME, [i, i, 2, 3, 4, 5, 6, 7]) for i in range(5)]
    frames[2] = frames[2][:9] + b"\xff" + frames[2][10:]
    decoder = ImuDecoder(FRAME)
    found = decoder.feed(0, b"".join(frames))
    assert [sample.values[3] for sample in found] == [0, 1, 3, 4]
    assert decoder.bad >= 1


def test_lines_of_another_kind_and_damaged_ones_are_told_apart() -> None:
    decoder = ImuDecoder(load_format("thinimu-micro"))
    text = (
        b"48,2050\r\nThinIMU ready\r\n# note\r\n2048,2049,2050,2051,2052,2053\r\n"
        b"2048,20x9,2050,2051,2052,2053\r\n2048,2049\r\n2048,2049,2050,2051,2052,2054\r\n"
    )
    assert [s.values[5] for s in decoder.feed(0, text)] == [2053, 2054]
    assert (decoder.bad, decoder.other) == (2, 2)  # the first, half a line, is neither


def test_a_wrapping_counter_runs_on() -> None:
    form = load_format("thinimu-micro-frame")
    data = b"".join(encode(form, [(65530 + i) % 65536, *[2048] * 6]) for i in range(12))
    times = [sample.device_ns for sample in ImuDecoder(form).feed(0, data)]
    assert np.all(np.diff(np.array(times, dtype=np.int64)) == 10_000_000)


def test_scaled_columns(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        'schema = "automap.imu-line/1"\ngyro_unit = "deg/s"\naccel_unit = "g"\n'
        '[binary]\nsync = "7E"\nstruct = "<6h"\nfields = ["ax","ay","az","gx","gy","gz"]\n'
        'checksum = "fletcher8"\nchecksum_from = 0\n[scale]\nax = 0.001\ngz = 0.1\n'
    )
    form = load_format(str(path))
    body = b"\x7e" + struct.pack("<6h", 1000, 2, 3, 4, 5, 60)
    check = CHECKSUMS["fletcher8"][1](body).to_bytes(2, "little")
    assert ImuDecoder(form).feed(0, body + check)[0].values == (4, 5, 6.0, 1.0, 2, 3)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "one of the sections"),
        ('[text]\ncolumns = ["gx","gy","gz","ax","ay"]', "lacks az"),
        ('[text]\ncolumns = ["gx","gy","gz","ax","ay","az","temp"]', "did you mean temp_c"),
        ('[text]\ncolumns = ["time","gx","gy","gz","ax","ay","az"]', "belong together"),
        ('[text]\nseperator = ","\ncolumns = ["gx","gy","gz","ax","ay","az"]', "did you mean"),
        ('[binary]\nsync = "AA"\nstruct = "6h"\nfields = ["gx","gy","gz","ax","ay","az"]', "<"),
        ('[binary]\nsync = "AA"\nstruct = "<5h"\nfields = ["gx","gy","gz","ax","ay","az"]', "5 v"),
        ('[binary]\nsync = "xx"\nstruct = "<6h"\nfields = ["gx","gy","gz","ax","ay","az"]', "sync"),
        ('gyro_unit = "counts"\n[text]\ncolumns = ["gx","gy","gz","ax","ay","az"]', "need a"),
        ('[text]\nchecksum = "md5"\ncolumns = ["gx","gy","gz","ax","ay","az"]', "checksum"),
        ('[text]\ncolumns = ["gx","gy","gz","ax","ay","az"]\n[scale]\ntemp_c = 2', "scale.temp_c"),
    ],
)  # fmt: skip
def test_a_wrong_format_is_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text('schema = "automap.imu-line/1"\n' + text)
    with pytest.raises(ConfigError, match=sentence) as caught:
        read_format(path)
    assert str(path) in str(caught.value)


def test_an_unknown_format_names_the_nearest() -> None:
    with pytest.raises(ConfigError, match="did you mean thinimu-micro"):
        load_format("thinimu-mikro")
