"""How far a run's figures are from stored ones, in their own sigmas."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from automap.errors import InputError
from automap.records import Sign, Trajectory
from automap.regression import epochs, scalars, signs
from automap.regression.change import Change, Tolerance
from automap.regression.record import (
    DriveRecord,
    compare,
    compare_timing,
    from_json,
    slower_stages,
    to_json,
)
from pipeline.regress.baseline import read_baseline, write_baseline

ALLOWED = Tolerance()


def trajectory(
    n: int = 2000, lat: float = -33.9, lon: float = 151.2, sd_m: float = 1.0
) -> Trajectory:
    """A curve at 10 m/s; ``sd_m`` and fixed fractions of it are the stated sigmas."""
    t = np.arange(n) * 0.01
    three = np.ones((n, 3))
    return Trajectory(
        t_ns=5_000_000_000 + np.rint(t * 1e9).astype(np.int64),
        gps_s=1.3e9 + t,
        lat_rad=np.radians(lat) + 10.0 * t / 6.37e6,
        lon_rad=np.radians(lon) + 30.0 * np.sin(t / 10.0) / 6.37e6,
        height_m=50.0 + 0.1 * t,
        vel_ned=np.column_stack([np.full(n, 10.0), 3.0 * np.cos(t / 10.0), np.full(n, -0.1)]),
        rpy=np.column_stack([0.01 * t, -0.01 * t, 3.0 + 0.1 * t]),
        sd_pos_ned=sd_m * three,
        sd_vel_ned=0.05 * three,
        sd_rpy=np.radians(0.3) * three,
    )


def sign(i: int, east_m: float = 0.0, **changes: object) -> Sign:
    """A sign a hundred metres north of the one before."""
    values: dict[str, object] = {
        "id": f"s{i:04d}",
        "class_name": "regulatory--stop--g1",
        "lat_rad": np.radians(48.0) + 100.0 * i / 6.37e6,
        "lon_rad": np.radians(11.0) + east_m / 6.37e6 / np.cos(np.radians(48.0)),
        "height_m": 500.0,
        "cov_enu": np.diag([1.0, 4.0, 2.0]),
        "confidence": 0.9,
        "n_views": 9,
        "first_seen_ns": 0,
        "last_seen_ns": 1,
        "height_above_road_m": 2.0,
        "facing_rad": 1.0,
        "size_m": 0.7,
        "side": "left",
    }
    return Sign(**(values | changes))  # type: ignore[arg-type]


def moved(changes: list[Change]) -> set[str]:
    return {change.name for change in changes if change.moved}


def stored(value: Trajectory) -> epochs.Epochs:
    """As it comes back from the file."""
    return epochs.from_json(epochs.to_json(epochs.sample(value)))


@pytest.mark.parametrize(("lat", "lon"), [(-33.9, 151.2), (51.0, 179.9999), (78.0, -180.0)])
def test_the_same_trajectory_has_not_moved(lat: float, lon: float) -> None:
    run = trajectory(lat=lat, lon=lon, sd_m=0.01)
    changes = epochs.compare(stored(run), run, ALLOWED)
    assert moved(changes) == set()
    # nor by what the file rounds away
    assert max(c.sigmas for c in changes if c.sigmas is not None) < 0.02


@settings(max_examples=25)
@given(share=st.sampled_from([0.05, 0.09, 0.11, 0.5]), axis=st.integers(0, 8))
def test_a_shift_is_judged_by_the_stated_sigma_of_its_component(share: float, axis: int) -> None:
    run = trajectory()
    block, part = divmod(axis, 3)
    step = np.zeros(3)
    step[part] = share * (1.0, 0.05, np.radians(0.3))[block]
    if block == 0:
        now = replace(
            run,
            lat_rad=run.lat_rad + step[0] / 6.3585e6,
            lon_rad=run.lon_rad + step[1] / (6.3849e6 * np.cos(np.radians(-33.9))),
            height_m=run.height_m - step[2],
        )
    elif block == 1:
        now = replace(run, vel_ned=run.vel_ned + step)
    else:
        now = replace(run, rpy=run.rpy + step)
    name = ("north", "east", "down", "v north", "v east", "v down", "roll", "pitch", "yaw")[axis]
    changes = {c.name: c for c in epochs.compare(stored(run), now, ALLOWED)}
    assert changes[name].sigmas == pytest.approx(share, rel=0.02)
    assert moved(list(changes.values())) == ({name} if share > 0.1 else set())


def test_a_jump_at_one_place_is_told_though_the_mean_is_small() -> None:
    run = trajectory()
    height = run.height_m.copy()
    height[990:1075] += 0.45
    changes = epochs.compare(stored(run), replace(run, height_m=height), ALLOWED)
    assert moved(changes) == {"down, worst epoch"}


def test_sigmas_that_change_and_epochs_that_are_lost_are_told() -> None:
    run = trajectory()
    wider = replace(run, sd_pos_ned=run.sd_pos_ned * 1.2)
    assert moved(epochs.compare(stored(run), wider, ALLOWED)) == {"stated sigma of position"}
    columns = Trajectory.__dataclass_fields__
    short = Trajectory(**{name: getattr(run, name)[:1500] for name in columns})
    assert "epochs covered" in moved(epochs.compare(stored(run), short, ALLOWED))
    assert moved(epochs.compare(stored(run), None, ALLOWED)) == {"trajectory"}


def test_unknown_attitude_stays_unknown_without_complaint() -> None:
    run = trajectory()
    blind = replace(run, rpy=np.full((2000, 3), np.nan), sd_rpy=np.full((2000, 3), np.nan))
    assert moved(epochs.compare(stored(blind), blind, ALLOWED)) == set()
    assert "yaw" in moved(epochs.compare(stored(run), blind, ALLOWED))


def test_signs_that_moved_came_went_or_changed_class() -> None:
    then = signs.from_json(signs.to_json(signs.reduce_signs([sign(i) for i in range(4)])))

    def changes(now: list[Sign]) -> set[str]:
        return moved(signs.compare(then, signs.reduce_signs(now), ALLOWED))

    assert changes([sign(i) for i in range(4)]) == set()
    assert changes([sign(i, east_m=0.05) for i in range(4)]) == set()
    assert changes([sign(i, east_m=0.4) for i in range(4)]) == {"position of 4 signs"}
    assert changes([sign(0, east_m=0.5), *map(sign, (1, 2, 3))]) == {"position of 4 signs"}
    assert changes([sign(i) for i in range(3)]) == {"signs gone"}
    assert changes([sign(i) for i in range(5)]) == {"signs new"}
    doubtful = sign(4, confidence=0.2)
    assert changes([*map(sign, range(4)), doubtful]) == set()
    other = sign(3, class_name="regulatory--yield--g1")
    assert changes([*map(sign, range(3)), other]) == {"classes changed"}
    assert changes([sign(i, confidence=0.7) for i in range(4)]) == {"mean confidence"}
    wide = [sign(i, cov_enu=np.diag([2.0, 8.0, 2.0])) for i in range(4)]
    assert changes(wide) == {"stated sigma of position"}


def test_metrics_that_state_a_sigma_are_found_by_their_name() -> None:
    figures = scalars.from_metrics(
        {
            "imu_delay_s": 0.04,
            "imu_delay_sd_s": 0.01,
            "mounting_rpy_deg": [1.0, 2.0, 3.0],
            "mounting_rpy_sd_deg": [0.1, 0.2, 0.3],
            "camera_front": {"time_offset_s": 0.5, "time_offset_sd_s": 0.1},
            "fixes": 12,
            "horizontal_sd_m": 1.2,
        }
    )
    assert figures == {
        "imu_delay_s": (0.04, 0.01),
        "mounting_rpy_deg.roll": (1.0, 0.1),
        "mounting_rpy_deg.pitch": (2.0, 0.2),
        "mounting_rpy_deg.yaw": (3.0, 0.3),
        "camera_front.time_offset_s": (0.5, 0.1),
    }


def test_single_figures_move_by_their_sigma_and_angles_round_the_circle() -> None:
    then = {"delay_s": (0.1, 0.01), "yaw_deg": (179.99, 0.1), "offset_s": (1.3e9, 0.0)}
    same = scalars.from_json(scalars.to_json(then))
    assert moved(scalars.compare(then, same, "sync", ALLOWED)) == set()
    now = {"delay_s": (0.13, 0.01), "yaw_deg": (-179.999, 0.1), "offset_s": (1.3e9, 0.0)}
    changes = {c.name: c for c in scalars.compare(then, now, "sync", ALLOWED)}
    assert changes["delay_s"].sigmas == pytest.approx(3.0)
    assert changes["yaw_deg"].sigmas == pytest.approx(0.11)
    assert not changes["offset_s"].moved
    gone = scalars.compare(then, {"delay_s": (0.1, 0.02)}, "sync", ALLOWED)
    assert moved(gone) == {"yaw_deg", "offset_s", "stated sigma of delay_s"}


def test_counts_move_by_their_square_root() -> None:
    assert moved(scalars.compare_counts({"fixes": 100}, {"fixes": 96}, ALLOWED)) == set()
    assert moved(scalars.compare_counts({"fixes": 100}, {"fixes": 94}, ALLOWED)) == {"fixes"}


def test_a_stage_must_be_much_slower_to_be_told() -> None:
    then = {"fuse": 10.0, "sync": 0.5}
    assert slower_stages(then, {"fuse": 19.0, "sync": 2.4}, ALLOWED) == []
    assert slower_stages(then, {"fuse": 21.0, "sync": 2.6}, ALLOWED) == ["fuse", "sync"]
    changes = compare_timing(then, {"fuse": 4.0, "sync": 0.5}, ALLOWED)
    assert moved(changes) == set()


def record() -> DriveRecord:
    run = trajectory()
    return DriveRecord(
        epochs=epochs.sample(run),
        path_en_m=[[0.0, 0.0], [1.5, 200.0]],
        signs=signs.reduce_signs([sign(1)]),
        sync={"offset_s": (1.0e9 + 0.123456, 3e-4)},
        calibration={"accel_bias_x": (0.05, 0.01)},
        counts={"fixes": 100},
        timing={"fuse": 12.3},
        truth={"position_rms_m.horizontal": 1.01},
        inputs={"imu.csv": "0123456789ab"},
        settings={"fuse.passes": 3},
    )


def test_a_record_survives_its_file(tmp_path: Path) -> None:
    path = tmp_path / "baseline.json"
    write_baseline(path, {"a": record(), "b": record()})
    back = read_baseline(path)
    assert set(back) == {"a", "b"}
    assert moved(compare(back["a"], record(), trajectory(), ALLOWED)) == set()
    assert back["a"].settings == {"fuse.passes": 3}
    # a few kB a drive, and again the same bytes
    assert path.stat().st_size < 2 * 8000
    text = path.read_bytes()
    write_baseline(path, back)
    assert path.read_bytes() == text


def test_changed_inputs_and_settings_are_told_and_not_judged() -> None:
    now = replace(record(), inputs={"imu.csv": "ffff"}, settings={}, truth={})
    changes = compare(record(), now, trajectory(), ALLOWED)
    told = [c.name for c in changes if c.group == "run" and c.size == "changed"]
    assert told == ["input imu.csv", "setting fuse.passes"]
    assert moved(changes) == set()


@settings(max_examples=30)
@given(part=st.floats(0.0, 0.99))
def test_a_baseline_cut_short_is_refused_in_one_sentence(
    tmp_path_factory: pytest.TempPathFactory, part: float
) -> None:
    path = tmp_path_factory.getbasetemp() / "damaged.json"
    write_baseline(path, {"a": record()})
    text = path.read_bytes()
    path.write_bytes(text[: int(part * len(text))])
    with pytest.raises(InputError, match=r"damaged\.json") as caught:
        read_baseline(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["trajectory", "signs", "sync", "counts", "timing", "path_en_m"])
@pytest.mark.parametrize("value", [None, 3, "text", [[1]], {"x": "y"}])
def test_figures_of_another_form_are_refused(tmp_path: Path, kind: str, value: object) -> None:
    path = tmp_path / "baseline.json"
    write_baseline(path, {"a": record()})
    content = json.loads(path.read_text())
    content["drives"]["a"][kind] = value
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match="figures of a are damaged"):
        read_baseline(path)


def test_another_schema_and_a_missing_file(tmp_path: Path) -> None:
    assert read_baseline(tmp_path / "none.json") == {}
    (tmp_path / "other.json").write_text('{"schema": "automap.run/1"}')
    with pytest.raises(InputError, match="schema"):
        read_baseline(tmp_path / "other.json")


def test_to_json_is_plain() -> None:
    value = to_json(record())
    assert from_json(json.loads(json.dumps(value))).counts == {"fixes": 100}
