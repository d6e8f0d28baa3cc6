"""Epochs: which messages belong together, their time, and what becomes a fix."""

from __future__ import annotations

from datetime import datetime, timedelta

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from receiver_messages import GPS, TOW, WEEK, clock, gga, message, pvt, rmc, sentence, zda

from automap import timebase as tb
from automap.errors import InputError
from automap.io.receiver import ReceiverLog, read_receiver_bytes, sniff
from automap.records import NO_TIME, FixType


def read(*parts: bytes) -> ReceiverLog:
    return read_receiver_bytes(b"".join(parts), "test.log")


def posllh(gps_s: float, **fields: float) -> bytes:
    values = {"lon": 1_500_000_000, "lat": -350_000_000, "height": 100_000, "hMSL": 80_000}
    accuracy = {"hAcc": 1_000, "vAcc": 2_000}
    return message(
        "NAV-POSLLH", **({"iTOW": round(gps_s % tb.WEEK_S * 1e3)} | values | accuracy | fields)
    )


def velned(gps_s: float) -> bytes:
    tow = round(gps_s % tb.WEEK_S * 1e3)
    return message("NAV-VELNED", iTOW=tow, velN=100, velE=200, velD=-30, sAcc=17)


def sol(gps_s: float, **fields: float) -> bytes:
    week, tow = tb.gps_to_week(gps_s)
    values = {"iTOW": round(float(tow) * 1e3), "week": int(week), "gpsFix": 3, "flags": 0x0D}
    return message("NAV-SOL", **(values | {"numSV": 6} | fields))


def test_pvt_alone() -> None:
    fixes = read(pvt(GPS), pvt(GPS + 0.2)).fixes
    assert np.allclose(fixes.gps_s, [GPS, GPS + 0.2], atol=1e-6)
    assert np.degrees(fixes.lat_rad[0]) == pytest.approx(-35.0)
    assert np.degrees(fixes.lon_rad[0]) == pytest.approx(150.0)
    assert fixes.height_m[0] == 100.0
    assert fixes.geoid_sep_m[0] == 20.0
    assert fixes.vel_ned[0].tolist() == [1.0, 2.0, -0.3]
    assert fixes.sd_pos_ned[0] == pytest.approx([np.sqrt(0.5), np.sqrt(0.5), 2.0])
    assert fixes.sd_vel_ned[0] == pytest.approx([0.0998824] * 3, rel=1e-4)
    assert fixes.offset.tolist() == [0, 100]
    assert (fixes.arrival_ns == NO_TIME).all()
    assert fixes.n_sats[0] == 9


@pytest.mark.parametrize(
    ("fields", "kind"),
    [
        ({"fixType": 0}, FixType.NONE),
        ({"fixType": 1}, FixType.DEAD_RECKONING),
        ({"fixType": 2}, FixType.TWO_D),
        ({"fixType": 3}, FixType.THREE_D),
        ({"fixType": 4}, FixType.THREE_D),
        ({"fixType": 5}, FixType.NONE),
        ({"flags": 0}, FixType.NONE),
        ({"flags": 3}, FixType.DGNSS),
        ({"flags": 0x43}, FixType.FLOAT),
        ({"flags": 0x83}, FixType.FIXED),
        ({"flags3": 1}, FixType.NONE),
    ],
)
def test_kinds_of_fix(fields: dict[str, float], kind: FixType) -> None:
    log = read(pvt(GPS, **fields))
    assert log.fixes.fix_type[0] == kind
    assert np.isnan(log.fixes.lat_rad[0]) == (kind == FixType.NONE)
    assert np.isnan(log.fixes.vel_ned[0, 0]) == (kind == FixType.NONE)
    assert any("no valid position" in w for w in log.warnings) == (kind == FixType.NONE)


def test_an_accuracy_of_all_bits_is_none() -> None:
    unknown = dict.fromkeys(("hAcc", "vAcc", "sAcc"), 2**32 - 1)
    fixes = read(pvt(GPS), pvt(GPS + 0.2, **unknown)).fixes
    assert np.isfinite(fixes.lat_rad).all()
    for told in (fixes.sd_pos_ned, fixes.sd_vel_ned):
        assert np.isnan(told).all(axis=1).tolist() == [False, True]


def test_the_old_set_makes_the_same_epoch() -> None:
    old = read(posllh(GPS), velned(GPS), sol(GPS)).fixes
    new = read(pvt(GPS)).fixes
    assert len(old) == 1
    for name in ("gps_s", "lat_rad", "lon_rad", "height_m", "vel_ned", "geoid_sep_m"):
        assert getattr(old, name) == pytest.approx(getattr(new, name), abs=1e-9)
    assert old.n_sats[0] == 6


def test_old_and_new_types_share_an_epoch() -> None:
    week, tow = tb.gps_to_week(GPS)
    time = message("NAV-TIMEGPS", iTOW=int(tow * 1e3), week=int(week), valid=7, leapS=18, fTOW=250)
    fine = message(
        "NAV-HPPOSLLH",
        iTOW=int(tow * 1e3),
        lon=1_500_000_000,
        lat=-350_000_000,
        height=100_000,
        hMSL=80_000,
        latHp=-50,
        heightHp=4,
        hAcc=100,
        vAcc=200,
    )
    cov = message(
        "NAV-COV", iTOW=int(tow * 1e3), posCovValid=1, posCovNN=4.0, posCovEE=9.0, posCovDD=16.0
    )
    dop = message("NAV-DOP", iTOW=int(tow * 1e3), hDOP=77)
    fixes = read(time, posllh(GPS), pvt(GPS), velned(GPS), fine, cov, dop, sol(GPS)).fixes
    assert len(fixes) == 1
    assert np.degrees(fixes.lat_rad[0]) == pytest.approx(-35.00000005, abs=1e-12)
    assert fixes.height_m[0] == pytest.approx(100.0004)
    assert fixes.sd_pos_ned[0].tolist() == [2.0, 3.0, 4.0]
    assert fixes.sd_vel_ned[0] == pytest.approx([0.0998824] * 3, rel=1e-4)
    assert fixes.hdop[0] == 0.77


def test_sol_alone_gives_position_and_velocity() -> None:
    # on the equator at 90 degrees east, moving north and up
    log = read(sol(GPS, ecefY=637_813_700 + 1_000, ecefVZ=250, ecefVY=100, pAcc=173, sAcc=17)).fixes
    assert np.degrees([log.lat_rad[0], log.lon_rad[0]]) == pytest.approx([0.0, 90.0])
    assert log.height_m[0] == pytest.approx(10.0, abs=1e-3)
    assert log.vel_ned[0] == pytest.approx([2.5, 0.0, -1.0])


def test_posllh_without_status_is_judged_by_its_accuracy() -> None:
    log = read(sol(GPS - 1), posllh(GPS), posllh(GPS + 1, hAcc=4_294_967_295)).fixes
    assert log.fix_type[1:].tolist() == [FixType.THREE_D, FixType.NONE]


def test_mixed_log_has_each_epoch_once_and_prefers_ubx() -> None:
    parts = []
    for k in range(5):
        t = GPS + 0.2 * k
        parts += [rmc(t), gga(t), zda(t), pvt(t)]
    log = read(*parts)
    fixes = log.fixes
    assert log.kind == "mixed"
    assert np.allclose(np.diff(fixes.gps_s), 0.2)
    assert fixes.vel_ned[0].tolist() == [1.0, 2.0, -0.3]
    assert fixes.offset[0] == 0
    assert fixes.hdop[0] == 0.9


def test_ubx_lost_in_an_epoch_is_made_good_by_nmea() -> None:
    damaged = bytearray(pvt(GPS + 1))
    damaged[40] ^= 1
    parts = [pvt(GPS), gga(GPS), rmc(GPS), bytes(damaged), gga(GPS + 1), rmc(GPS + 1)]
    log = read(*parts, pvt(GPS + 2), gga(GPS + 2), rmc(GPS + 2))
    assert np.allclose(log.fixes.gps_s, [GPS, GPS + 1, GPS + 2], atol=1e-6)
    assert log.bad_checksums == 1
    assert (log.fixes.fix_type == FixType.THREE_D).all()
    assert np.isnan(log.fixes.vel_ned[1, 2])


def test_nmea_alone() -> None:
    vtg = sentence("GPVTG,90.0,T,,M,20.0,N,37.0,K,A")
    gst = sentence(f"GPGST,{clock(GPS)},1,2,3,4,1.5,2.5,3.5")
    fixes = read(gga(GPS), rmc(GPS), vtg, gst).fixes
    assert len(fixes) == 1
    assert fixes.gps_s[0] == pytest.approx(GPS, abs=0.006)
    assert fixes.height_m[0] == 100.0
    assert fixes.geoid_sep_m[0] == 20.0
    assert fixes.vel_ned[0, :2] == pytest.approx([0.0, 10.0 * 1852 / 3600], abs=1e-9)
    assert fixes.sd_pos_ned[0].tolist() == [1.5, 2.5, 3.5]
    assert np.isnan(fixes.vel_ned[0, 2])


def test_without_rmc_the_date_is_zdas_and_the_speed_vtgs() -> None:
    vtg = sentence("GPVTG,0.0,T,,M,20.0,N,37.0,K,A")
    fixes = read(gga(GPS), vtg, gga(GPS + 1), vtg, zda(GPS + 1), gga(GPS + 2), vtg).fixes
    assert np.allclose(fixes.gps_s, GPS + np.arange(3), atol=0.006)
    assert fixes.vel_ned[:, 0] == pytest.approx([20.0 * 1852 / 3600] * 3)


def test_rmc_alone_is_a_flat_fix() -> None:
    fixes = read(rmc(GPS), rmc(GPS + 1, speed="0.02", course="")).fixes
    assert fixes.fix_type.tolist() == [FixType.TWO_D] * 2
    assert np.isnan(fixes.height_m).all()
    assert fixes.vel_ned[1, :2].tolist() == pytest.approx([0.01028889, 0.0])


def test_unknown_course_at_speed_is_no_velocity() -> None:
    fixes = read(rmc(GPS, speed="5.0", course="")).fixes
    assert np.isnan(fixes.vel_ned[0]).all()


def test_gns_modes() -> None:
    def gns(mode: str) -> bytes:
        return sentence(f"GNGNS,{clock(GPS)},3500.0,S,15000.0,E,{mode},12,0.7,80.0,20.0,,,S")

    for mode, kind in (("AN", 3), ("DAA", 4), ("RF", 6), ("FA", 5), ("NN", 0), ("EN", 1)):
        assert read(rmc(GPS - 1), gns(mode)).fixes.fix_type[1] == kind
    assert read(gns("AA"), zda(GPS)).fixes.height_m[0] == 100.0


def test_gsa_tells_a_flat_fix() -> None:
    gsa = sentence("GPGSA,A,2,01,02,03,,,,,,,,,,1.5,1.2,0.9")
    assert read(gga(GPS), gsa, zda(GPS)).fixes.fix_type[0] == FixType.TWO_D


def test_a_warned_epoch_stays_as_an_empty_row() -> None:
    log = read(gga(GPS), rmc(GPS), gga(GPS + 1), rmc(GPS + 1, status="V"), gga(GPS + 2, quality=0))
    assert log.fixes.fix_type.tolist() == [FixType.THREE_D, FixType.NONE, FixType.NONE]
    assert np.isnan(log.fixes.lat_rad[1:]).all()


def test_a_quality_that_no_fix_has_is_a_plain_fix_and_told() -> None:
    log = read(gga(GPS, quality=9), gga(GPS + 1, quality=12), rmc(GPS + 1))
    assert log.fixes.fix_type.tolist() == [FixType.DGNSS, FixType.THREE_D]
    assert any("1 GGA positions have a quality that no kind" in text for text in log.warnings)


def test_pubx() -> None:
    text = f"PUBX,00,{clock(GPS)},3500.0,S,15000.0,E,100.5,D3,2.0,3.0,36.0,90.0,-0.5,,0.9,1,1,9,0,0"
    fixes = read(sentence(text), zda(GPS)).fixes
    assert fixes.fix_type[0] == FixType.DGNSS
    assert fixes.vel_ned[0] == pytest.approx([0.0, 10.0, -0.5], abs=1e-9)
    assert fixes.sd_pos_ned[0] == pytest.approx([np.sqrt(2), np.sqrt(2), 3.0])
    assert fixes.height_m[0] == 100.5


@settings(max_examples=30)
@given(
    start=st.floats(-4.0, 4.0),
    boundary=st.sampled_from([WEEK * tb.WEEK_S, WEEK * tb.WEEK_S + 3 * tb.DAY_S]),
    form=st.sampled_from(["pvt", "old", "gga+first zda", "gga+last zda", "rmc", "mixed"]),
)
def test_day_and_week_rollovers(start: float, boundary: int, form: str) -> None:
    """Epochs on both sides of midnight, of GPS time or UTC, and of the week."""
    times = boundary + 18.0 * (boundary % 2) + round(start, 1) + np.arange(8.0)
    parts = []
    for k, t in enumerate(times):
        if form in ("pvt", "mixed"):
            parts.append(pvt(t))
        if form == "old":
            parts += [posllh(t), velned(t)]
            if k == 2:
                parts.append(sol(t))
        if form.startswith("gga"):
            parts.append(gga(t))
        if (form == "gga+first zda" and k == 0) or (form == "gga+last zda" and k == 7):
            parts.append(zda(t))
        if form in ("rmc", "mixed"):
            parts.append(rmc(t))
    log = read(*parts)
    assert np.allclose(log.fixes.gps_s, times, atol=1e-3)
    assert not any("backwards" in w for w in log.warnings)


def test_ubx_without_week_takes_it_from_nmea() -> None:
    log = read(posllh(GPS), velned(GPS), rmc(GPS), posllh(GPS + 1), velned(GPS + 1))
    assert np.allclose(log.fixes.gps_s, [GPS, GPS + 1], atol=1e-6)


def test_a_log_without_any_date_counts_from_the_first_day() -> None:
    log = read(gga(GPS), gga(GPS + 1))
    assert log.period_s == tb.DAY_S
    assert np.diff(log.fixes.gps_s) == pytest.approx(1.0)
    assert 0 <= log.fixes.gps_s[0] < 2 * tb.DAY_S
    assert read(posllh(GPS), velned(GPS)).period_s == tb.WEEK_S
    assert read(gga(GPS), rmc(GPS)).period_s is None


def test_dates_of_a_past_era_are_moved_on() -> None:
    past = GPS - tb.ROLLOVER_S
    log = read(rmc(GPS, date="130504"), gga(GPS))
    assert any("1024" in w for w in log.warnings)
    assert float(log.fixes.gps_s[0]) > past
    year, month, day, *_ = (2004, 5, 13)
    moved = tb.days_since_epoch(year, month, day) * tb.DAY_S + tb.ROLLOVER_S
    assert abs(log.fixes.gps_s[0] - moved) < tb.DAY_S + 20
    # one that may as well be right is left, and told
    (said,) = read(rmc(GPS, date="250906"), gga(GPS)).warnings
    assert "starts at 2006-09-25" in said
    assert "of 2026-05-11, 1024 weeks on" in said
    assert read(rmc(GPS, date="110526"), gga(GPS)).warnings == []


@pytest.mark.parametrize(
    ("days", "wrong"),
    [
        (-7168, slice(0, 7)),  # until it knows the era of its week
        (-7168, slice(3, 10)),  # from a loss of a minute on
        (-9700, slice(0, 2)),
        (400, slice(5, 6)),
        (-1, slice(4, 5)),  # RMC's date late by a sentence
    ],
)
def test_a_date_that_the_time_of_day_contradicts_is_that_of_the_others(
    days: int, wrong: slice
) -> None:
    start = GPS + 1200.0 * tb.DAY_S  # an era before it is none that is moved by itself
    times = start + np.array([0.0, 1.0, 2.0, 63.0, 64.0, 65.0, 66.0, 67.0, 68.0, 69.0])
    date = (datetime(1980, 1, 6) + timedelta(seconds=start, days=days)).strftime("%d%m%y")
    said = {float(t): {"date": date} for t in times[wrong]}
    log = read(*(part for t in times for part in (gga(t), rmc(t, **said.get(float(t), {})))))
    assert np.allclose(log.fixes.gps_s, times, atol=1e-3)
    assert any(f"{wrong.stop - wrong.start} messages tell another date" in w for w in log.warnings)


def test_talkers_of_one_receiver_make_one_epoch_and_two_receivers_are_told() -> None:
    times = GPS + 0.2 * np.arange(10.0)
    one = read(*(part for t in times for part in (gga(t), rmc(t))))
    again = read(*(part for t in times for part in (rmc(t), rmc(t), gga(t), gga(t), rmc(t))))
    assert np.array_equal(again.fixes.gps_s, one.fixes.gps_s)
    assert np.array_equal(again.fixes.height_m, one.fixes.height_m)
    assert any("time and place of the one before again" in w for w in again.warnings)
    beside = [
        sentence(gga(t)[1:].split(b"*")[0].decode().replace("3500.0000", "3500.0020"))
        for t in times
    ]
    two = read(*(part for t, other in zip(times, beside, strict=True) for part in (gga(t), other)))
    assert len(two.fixes) == 20
    assert any("10 epochs repeat the time of the one before, 3.7 m off" in w for w in two.warnings)


def test_two_drives_in_one_log_keep_their_days() -> None:
    times = np.concatenate([GPS + np.arange(5.0), GPS + 30 * tb.DAY_S + 900 + np.arange(3.0)])
    log = read(*(rmc(t) for t in times))
    assert np.allclose(log.fixes.gps_s, times, atol=1e-3)


def test_the_leap_second_of_2016() -> None:
    rows = [("235958.00", "311216"), ("235959.00", "311216"), ("235960.00", "311216")]
    rows += [("000000.00", "010117"), ("000001.00", "010117")]
    parts = []
    for time, date in rows:
        parts.append(sentence(f"GPRMC,{time},A,3500.0,S,15000.0,E,1.0,90.0,{date},,,A"))
        parts.append(sentence(f"GPGGA,{time},3500.0,S,15000.0,E,1,08,0.9,80.0,M,20.0,M,,"))
    fixes = read(*parts).fixes
    assert np.allclose(np.diff(fixes.gps_s), 1.0)
    assert fixes.gps_s[-1] == float(tb.calendar_to_gps(2017, 1, 1, 1.0))


def test_a_receiver_with_its_own_idea_of_leap_seconds_is_joined_by_it() -> None:
    """Before the almanac is in, UTC may be seconds off; PVT tells by how much."""
    parts = []
    for k in range(4):
        t = GPS + k
        wrong = t + 2.0  # UTC written as if there were 16 leap seconds
        shifted = pvt(wrong, iTOW=round((TOW + k) * 1e3))
        parts += [shifted, gga(wrong), rmc(wrong)]
    fixes = read(*parts).fixes
    assert np.allclose(fixes.gps_s, GPS + np.arange(4), atol=1e-6)


def test_end_of_epoch_sends_untimed_sentences_to_the_next() -> None:
    tow = round(TOW * 1e3)
    slow, fast = (sentence(f"GPVTG,0.0,T,,M,{v},N,,K,A") for v in ("10.0", "20.0"))
    parts = [posllh(GPS), message("NAV-EOE", iTOW=tow), slow, posllh(GPS + 1)]
    parts += [message("NAV-EOE", iTOW=tow + 1000), fast, posllh(GPS + 2), sol(GPS + 2)]
    fixes = read(*parts).fixes
    assert len(fixes) == 3
    assert fixes.vel_ned[1, 0] == pytest.approx(10 * 1852 / 3600)


def test_times_that_run_backwards_are_kept_and_said() -> None:
    log = read(pvt(GPS), pvt(GPS + 1), pvt(GPS - 50), pvt(GPS - 49))
    assert np.allclose(log.fixes.gps_s, [GPS, GPS + 1, GPS - 50, GPS - 49], atol=1e-6)
    assert any("backwards" in w for w in log.warnings)


def test_sentences_without_checksum() -> None:
    bare = [gga(GPS + k).split(b"*")[0] + b"\r\n" for k in range(3)]
    log = read(*bare, zda(GPS))
    assert len(log.fixes) == 3
    assert any("no checksum" in w for w in log.warnings)
    log = read(gga(GPS), bare[1], gga(GPS + 2), zda(GPS))
    assert len(log.fixes) == 2
    assert any("lack the checksum" in w for w in log.warnings)


def test_what_the_end_cuts_off_is_said() -> None:
    assert "UBX-NAV-PVT at byte 100" in (read(pvt(GPS), pvt(GPS + 1)[:60]).truncated or "")
    assert "$GPGGA" in (read(pvt(GPS), gga(GPS)[:20]).truncated or "")
    assert "checksum" in (read(gga(GPS), zda(GPS), gga(GPS)[:20] + b"\n").truncated or "")
    assert read(pvt(GPS)).truncated is None


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "empty"),
        (b"\r\n\r\n", "empty"),
        (b'<?xml version="1.0"?><gpx version="1.1"><trk>', "is not whole as GPX"),
        (b"hello world" * 50, "no UBX, NMEA or RTKLIB"),
        (bytes(range(256)) * 10, "no UBX, NMEA or RTKLIB"),
        (zda(GPS), "no message with a position"),
        (message("NAV-EOE", iTOW=1), "no message with a position"),
        (gga(GPS).replace(b"35", b"36"), "wrong checksum"),
    ],
)
def test_unusable_files_are_one_clear_sentence(data: bytes, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        read(data)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("test.log")


@settings(max_examples=60)
@given(st.data())
def test_damage_never_breaks_the_reader(data: st.DataObject) -> None:
    parts = [pvt(GPS), gga(GPS), rmc(GPS), posllh(GPS + 1), sol(GPS + 1), zda(GPS + 1)]
    stream = bytearray(b"".join(parts * 2))
    for _ in range(data.draw(st.integers(0, 6))):
        stream[data.draw(st.integers(0, len(stream) - 1))] = data.draw(st.integers(0, 255))
    del stream[data.draw(st.integers(1, len(stream))) :]
    try:
        log = read(bytes(stream))
    except InputError:
        return
    assert (np.diff(log.fixes.offset) > 0).all()
    placed = log.fixes.fix_type != FixType.NONE
    assert np.isfinite(log.fixes.lat_rad[placed]).all()
    assert np.isfinite(log.fixes.gps_s).all()


def test_sniffing() -> None:
    assert sniff(pvt(GPS)) == "ubx"
    assert sniff(gga(GPS)) == "nmea"
    assert sniff(gga(GPS) + pvt(GPS)) == "mixed"
    assert sniff(b"% program   : RTKLIB\n") == "rtklib"
    assert sniff(b"2025/07/08 19:34:18.499 40.09 -105.14 1601.47 1 21\n") == "rtklib"
    assert sniff(b"t_ns,gx,gy\n1,2,3\n") is None
    assert sniff(b"") is None
