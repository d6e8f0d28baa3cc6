"""The drive folder that the simulator writes, and its scenario files."""

from __future__ import annotations

import json
import tomllib
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest
from pyubx2 import UBXReader

from automap.errors import ConfigError
from automap.io.drive import load_drive
from automap.io.ubx_writer import nav_pvt
from automap.records import NO_TIME, Fixes, FixType
from automap.simulation.gnss import arrivals
from automap.simulation.scenario import Gnss, parse_scenario
from pipeline.shared.configs import configs_dir
from pipeline.simulate.command import _scenario_file, load_scenario, simulate

SMALL = """
schema = "automap.scenario/1"
name = "small"
[start]
utc = 2026-03-14T09:20:00Z
lat_deg = -35.28
lon_deg = 149.13
height_m = 580.0
heading_deg = 20.0
standstill_s = 1.0
[clock]
drift_ppm = 20.0
[route]
end_standstill_s = 0.5
legs = [{ length_m = 25.0, speed_m_s = 9.0 }]
[errors]
accel_bias = { x = 0.05 }
[gnss]
rate_hz = 4.0
lever_arm_m = [0.4, 0.1, -1.2]
dropouts = [[3.0, 1.0]]
geoid_separation_m = 19.4
[camera]
width = 320
height = 180
focal_px = 250.0
frame_rate_hz = 2.0
[[signs]]
at_m = 20.0
sign = "regulatory--stop--g1"
offset_m = -3.0
"""


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("simulated")
    (folder / "small.toml").write_text(SMALL)
    simulate(folder / "small.toml", folder / "drive")
    return folder / "drive"


def test_the_manifest_and_its_files_load(drive: Path) -> None:
    loaded = load_drive(drive)
    assert loaded.name == "small"
    assert not loaded.warnings
    camera = loaded.cameras()["front"]
    assert camera.matrix[0, 2] == pytest.approx(159.5)
    np.testing.assert_allclose(loaded.lever_arm, [0.4, 0.1, -1.2])
    assert loaded.truth_dir is not None


def test_the_truth_stands_on_the_imu_epochs(drive: Path) -> None:
    imu = np.genfromtxt(drive / "imu.csv", delimiter=",", skip_header=1)
    truth = np.genfromtxt(drive / "truth" / "trajectory.csv", delimiter=",", skip_header=1)
    np.testing.assert_array_equal(imu[:, 0], truth[:, 0])
    rate = np.polyfit(truth[:, 0] * 1e-9 - 1000, truth[:, 1] - truth[0, 1], 1)[0]
    assert rate == pytest.approx(1.0 + 20e-6, abs=2e-6)
    assert imu[:100, 6].mean() == pytest.approx(-9.79, abs=0.05)


def test_the_receiver_log_follows_the_truth(drive: Path) -> None:
    with (drive / "gnss.ubx").open("rb") as stream:
        messages = [message for _, message in UBXReader(stream)]
    truth = np.genfromtxt(drive / "truth" / "trajectory.csv", delimiter=",", skip_header=1)
    fixed = [m for m in messages if m.gnssFixOk]
    assert len(messages) - len(fixed) == 4
    assert all(m.fixType == 3 for m in fixed)
    first, last = fixed[0], fixed[-1]
    metres = np.deg2rad(1.0) * 6.36e6
    assert abs(first.lat - truth[0, 2]) * metres < 6.0
    assert abs(last.lat - truth[-1, 2]) * metres < 6.0
    assert last.lat > first.lat
    assert first.height - first.hMSL == pytest.approx(19400, abs=1)
    arrival = np.genfromtxt(drive / "gnss_arrival.csv", delimiter=",", skip_header=1)
    assert len(arrival) == len(messages)
    np.testing.assert_array_equal(np.diff(arrival[:, 0]), 100)


def test_signs_have_a_place_and_a_class(drive: Path) -> None:
    signs = json.loads((drive / "truth" / "signs.geojson").read_text())["features"]
    assert [s["properties"]["class"] for s in signs] == ["regulatory--stop--g1"]
    lon, lat, height = signs[0]["geometry"]["coordinates"]
    # 20 m along a heading of 20 degrees and 3 m to the left of it
    north = (lat + 35.28) * np.deg2rad(1.0) * 6.36e6
    east = (lon - 149.13) * np.deg2rad(1.0) * 6.386e6 * np.cos(np.deg2rad(35.28))
    assert north == pytest.approx(20 * 0.9397 + 3 * 0.3420, abs=0.3)
    assert east == pytest.approx(20 * 0.3420 - 3 * 0.9397, abs=0.3)
    assert height == pytest.approx(580.0 - 0.5 + 2.2, abs=0.1)


def test_the_seed_decides_everything(drive: Path, tmp_path: Path) -> None:
    scenario = tmp_path / "small.toml"
    scenario.write_text(SMALL)
    simulate(scenario, tmp_path / "same")
    simulate(scenario, tmp_path / "other", seed=99)
    for name in ("imu.csv", "gnss.ubx", "gnss_arrival.csv", "video/front.mp4", "drive.toml"):
        assert (tmp_path / "same" / name).read_bytes() == (drive / name).read_bytes()
    assert (tmp_path / "other" / "imu.csv").read_bytes() != (drive / "imu.csv").read_bytes()


def test_a_failure_leaves_nothing_behind(tmp_path: Path) -> None:
    scenario = tmp_path / "bad.toml"
    scenario.write_text(SMALL.replace("regulatory--stop--g1", "regulatory--halt--g1"))
    with pytest.raises(ConfigError, match="regulatory--halt--g1"):
        simulate(scenario, tmp_path / "drive")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bad.toml"]


def test_a_folder_of_a_scenarios_name_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sample").mkdir()
    monkeypatch.chdir(tmp_path)
    assert _scenario_file("sample") == configs_dir() / "scenarios" / "sample.toml"


def test_an_existing_drive_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "drive").mkdir()
    (tmp_path / "drive" / "imu.csv").write_text("precious")
    with pytest.raises(ConfigError, match="exists already"):
        simulate("sample", tmp_path / "drive")
    assert (tmp_path / "drive" / "imu.csv").read_text() == "precious"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("drift_ppm", "drift_pmm", "did you mean drift_ppm"),
        ("length_m = 25.0", "length_m = -1.0", "length_m"),
        ("length_m = 25.0", "length_m = 25.0, radius_m = 5.0", "arc"),
        ("lat_deg = -35.28\n", "", "lat_deg is missing"),
        ("name = ", "name ", "not valid TOML"),
    ],
)
def test_mistakes_in_a_scenario_are_named(tmp_path: Path, old: str, new: str, said: str) -> None:
    scenario = tmp_path / "small.toml"
    scenario.write_text(SMALL.replace(old, new))
    with pytest.raises(ConfigError, match=said):
        load_scenario(scenario)


@pytest.mark.parametrize(
    ("section", "said"),
    [
        ("[gnss]\nsigma_white_m = [0.2, -1.0, 0.2]", r"gnss.sigma_white_m.1 is not accepted"),
        ("[gnss]\nstated_sd_m = [0.0, 1.0, 1.0]", r"gnss.stated_sd_m.0"),
        ("[gnss]\nrate_hz = 1e-9", "gnss.rate_hz"),
        ("[gnss]\nlever_arm_m = [400, 0, -1200]", r"gnss.lever_arm_m.0"),
        ("[imu]\nrate_hz = 1e9", "imu.rate_hz"),
        ("[imu]\ngyro_noise = 1e9", "imu.gyro_noise"),
        ("[clock]\ndrift_ppm = -1e6", "clock.drift_ppm"),
        ("[start]\nheight_m = 1e7", "start.height_m"),
        ("[start]\nutc = 1850-05-11T09:20:00Z", "the year 1850"),
        ("[site]\ncountry = 'Deutschland'", "site.country"),
        ("[route]\ntransition_m = 1e6", "route.transition_m"),
        ("[route]\nlegs = []", "route.legs"),
        ("[route]\nlegs = [{ length_m = 1e-9 }]", "its legs are 1e-09 m long"),
        ("[route]\nlegs = [{ turn_deg = 3e4, radius_m = 1e6 }]", "its legs are"),
        ("[route]\nstops = [{ at_m = 3e4, hold_s = 5 }]", "is beyond its"),
        ("[errors]\naccel_bias = { x = nan }", r"errors.accel_bias.x is not accepted"),
    ],
)
def test_values_that_nothing_has_are_refused_with_their_place(section: str, said: str) -> None:
    content = tomllib.loads(SMALL)
    for key, values in tomllib.loads(section).items():
        content[key] = {**content.get(key, {}), **values}
    with pytest.raises(ConfigError, match=said) as told:
        parse_scenario(content, Path("small.toml"))
    assert str(told.value).startswith("small.toml: ")


@pytest.mark.parametrize(
    ("section", "country", "side"),
    [
        ("", "AU", "left"),
        ("[start]\nlat_deg = 48.0", None, None),
        ("[start]\nlat_deg = 48.0\n[site]\ncountry = 'FR'\ntraffic_side = 'right'", "FR", "right"),
        ("[site]\ncountry = 'NZ'", "NZ", None),
    ],
)
def test_a_drive_has_the_country_that_is_said(
    section: str, country: str | None, side: str | None
) -> None:
    content = tomllib.loads(SMALL)
    for key, values in tomllib.loads(section).items():
        content[key] = {**content.get(key, {}), **values}
    place = parse_scenario(content, Path("small.toml")).place
    assert (place.country, place.traffic_side) == (country, side)


def test_a_time_without_a_zone_is_utc() -> None:
    content = tomllib.loads(SMALL)
    stated = parse_scenario(content, Path("small.toml")).start.utc
    content["start"]["utc"] = stated.replace(tzinfo=None)
    assert parse_scenario(content, Path("small.toml")).start.utc == stated
    assert stated.utcoffset() == timedelta(0)


def test_a_scenario_that_does_not_exist_is_named() -> None:
    with pytest.raises(ConfigError, match=r"no scenario 'sampel'; .*sample"):
        simulate("sampel", Path("nowhere"))


def _fixes(gps_s: list[float]) -> Fixes:
    n = len(gps_s)
    return Fixes(
        gps_s=np.array(gps_s),
        lat_rad=np.full(n, np.deg2rad(-35.28)),
        lon_rad=np.full(n, np.deg2rad(-179.99)),
        height_m=np.full(n, 123.456),
        vel_ned=np.tile([-3.0, 4.0, 0.25], (n, 1)),
        sd_pos_ned=np.tile([0.3, 0.4, 0.7], (n, 1)),
        sd_vel_ned=np.tile([0.02, 0.03, 0.06], (n, 1)),
        fix_type=np.full(n, FixType.THREE_D, np.int64),
        n_sats=np.full(n, 12, np.int64),
        hdop=np.full(n, 0.9),
        geoid_sep_m=np.full(n, -20.0),
        offset=np.full(n, -1, np.int64),
        arrival_ns=np.full(n, NO_TIME, np.int64),
    )


def test_nav_pvt_as_another_library_reads_it() -> None:
    # 0.75 s past a whole second; the last instant of a week; the last of a UTC day
    times = [1457515218.75, 604800.0 * 2410 - 0.2, 1451606417.8]
    stream = b"".join(nav_pvt(_fixes(times)))
    messages = [UBXReader.parse(stream[i : i + 100]) for i in range(0, 300, 100)]
    first, second, third = messages
    assert (first.hour, first.min, first.second, first.nano) == (9, 20, 1, -250_000_000)
    assert (first.year, first.month, first.day) == (2026, 3, 14)
    assert first.velN == -3000
    assert first.gSpeed == 5000
    assert first.headMot == pytest.approx(126.8699, abs=1e-4)
    assert (first.hAcc, first.vAcc, first.sAcc) == (500, 700, 70)
    assert first.lon == pytest.approx(-179.99)
    assert (first.height, first.hMSL) == (123456, 143456)
    assert second.iTOW == 604_800_000 - 200
    # eighteen leap seconds before midnight
    assert (second.hour, second.min, second.second, second.nano) == (23, 59, 42, -200_000_000)
    assert (third.year, third.month, third.day) == (2026, 1, 5)
    assert (third.hour, third.min, third.second, third.nano) == (0, 0, 0, -200_000_000)


def test_bytes_arrive_late_and_in_order() -> None:
    gps_s = np.arange(2000) * 0.2
    setup = Gnss(burst_probability=0.1, output_delay_s=0.05)
    stamps = arrivals(
        gps_s, setup, lambda s: np.rint(s * 1e9).astype(np.int64), np.random.default_rng(1)
    )
    delay = stamps * 1e-9 - gps_s
    assert (np.diff(stamps) > 0).all()
    assert delay.min() >= 0.05 - 1e-6
    assert np.median(delay) < 0.07
    assert delay.max() > 0.2


@pytest.mark.parametrize(("stated", "height"), [("", 46.0), ("geoid_separation_m = 0.0", 0.0)])
def test_a_receiver_tells_the_geoid_of_the_place(
    stated: str, height: float, tmp_path: Path
) -> None:
    """In Munich it is 46 m above the ellipsoid; a check of such a drive warns of none."""
    (tmp_path / "munich.toml").write_text(
        'schema = "automap.scenario/1"\nname = "munich"\n[start]\nutc = "2026-03-14T09:20:00Z"\n'
        "lat_deg = 48.14\nlon_deg = 11.58\n[route]\nlegs = [{ length_m = 25.0, speed_m_s = 9.0 }]\n"
        f"[gnss]\n{stated}\n"
    )
    setup = load_scenario(tmp_path / "munich.toml").gnss
    assert setup is not None
    assert setup.geoid_separation_m == pytest.approx(height, abs=6.0)
    assert (setup.geoid_separation_m == 0.0) == bool(stated)
