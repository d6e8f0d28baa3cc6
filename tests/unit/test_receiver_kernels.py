"""Compiled or interpreted, the reader's loops give the same to the last bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from receiver_messages import GPS, gga, message, pvt, rmc, sentence, zda
from test_receiver_rtklib import file_of

from automap.errors import InputError
from automap.io import kernel
from automap.io.receiver import read_receiver_bytes
from automap.io.scan_kernel import _crc24q, _fletcher

PIECES = [
    pvt(GPS),
    pvt(GPS + 0.2, flags=0x83),
    message("NAV-SOL", iTOW=300_000_000, week=2300, gpsFix=3, flags=0x0D, fTOW=-2_000),
    message("NAV-EOE", iTOW=300_000_000),
    gga(GPS),
    gga(GPS + 0.2, quality=4),
    rmc(GPS, speed="", course=""),
    rmc(GPS + 0.2, date=""),
    zda(GPS + 0.4),
    sentence("GPGSA,A,2,01,02,,,,,,,,,,,1.5,0.9,1.2"),
    sentence("GPGSV,1,1,02,01,40,083,46,02,17,308,41,A"),
    sentence("GNVTG,54.7,T,34.4,M,005.5,N,010.2,K,A"),
    sentence("GPGGA,123456789012345678901.5,-1.,S,,E,1.5.2,+8,--1,1e3,M,,M,,"),
    b"$GPRMC,no checksum\r\n",
    b"# a comment\n",
    b"\xb5\x62\x01\x07\xff",
    b"\xd3\x00\x04\x3e\xd0\x00\x03\x00\x00\x00",
]


def outcome(data: bytes) -> list[Any]:
    """All that is read, or the sentence of the error."""
    try:
        log = read_receiver_bytes(data, "x")
    except InputError as error:
        return [str(error)]
    found: list[Any] = [log.messages, log.warnings, log.truncated, log.bad_checksums]
    found += [log.kind, log.garbage_bytes]
    tables = [vars(log.fixes)] + [table.columns for table in log.ubx.values()]
    for table in tables + list(log.nmea.values()):
        # bytes, for a NaN is not equal to itself
        found.append({name: (v.dtype.str, v.tobytes()) for name, v in table.items()})
    return found


def assert_both_alike(data: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    results = []
    for threshold in (0, len(data) + 1):
        monkeypatch.setattr(kernel, "INTERPRET_BELOW", threshold)
        results.append(outcome(data))
    assert results[0] == results[1]


@settings(
    max_examples=30,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    pieces=st.lists(st.sampled_from(PIECES) | st.binary(max_size=12), max_size=25),
    flips=st.lists(st.tuples(st.integers(0, 5_000), st.integers(0, 255)), max_size=6),
    cut=st.integers(0, 30),
)
def test_any_stream(
    pieces: list[bytes], flips: list[tuple[int, int]], cut: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = bytearray(b"".join(pieces))
    for place, value in flips:
        if data:
            data[place % len(data)] = value
    assert_both_alike(bytes(data[: max(len(data) - cut, 0)]), monkeypatch)


@pytest.mark.parametrize("position", ["llh", "dms", "xyz"])
def test_rtklib_solutions(position: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert_both_alike(file_of("GPST", position), monkeypatch)


def test_checksums_of_long_messages_do_not_overflow() -> None:
    body = np.full(16_388, 255, np.uint8)
    table = np.arange(256, dtype=np.int64) * 0x10101
    for checksum, arguments in ((_fletcher, (body,)), (_crc24q, (body, table))):
        assert checksum.compiled(*arguments) == checksum.run(1, *arguments)
