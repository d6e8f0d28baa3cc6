"""What a missing effect costs: paths laid side by side, and how few fits that takes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from automap.earth import metres_per_radian
from automap.frames import matrix_to_quat, rpy_to_matrix
from automap.gap import base_model, confirm
from automap.gap import costs as paths
from automap.gap.costs import HeldPath, cost_between, costs, moved
from automap.gap.fit import GapModel
from automap.gap.stochastic import noise_levels
from pipeline.gap.cost_json import held_out_json
from pipeline.pages.plan_plot import _axes, draw_plan
from pipeline.pages.svg_plot import Series

LAT, HEIGHT = 0.84, 400.0


def path(
    north: float = 0.0,
    east: float = 0.0,
    up: float = 0.0,
    yaw: float = 0.3,
    pitch: float = 0.0,
    n: int = 50,
) -> HeldPath:
    """A drive to the north, moved by metres."""
    t = np.arange(n) * 0.1
    per_lat, per_lon = metres_per_radian(LAT, HEIGHT)
    pos = np.column_stack(
        [
            LAT + (10.0 * t + north) / per_lat,
            np.full(n, 0.2 + east / float(per_lon)),
            np.full(n, HEIGHT + up),
        ]
    )
    quat = np.tile(matrix_to_quat(rpy_to_matrix(np.array([0.01, pitch, yaw]))), (n, 1))
    return HeldPath(t, pos, quat)


def test_paths_are_compared_in_metres_and_angles() -> None:
    found = cost_between([path()], [path(north=0.3, east=-0.4, up=-0.2, yaw=0.31, pitch=0.002)])
    assert found.level.rms == pytest.approx(0.5, rel=1e-3)
    assert found.level.largest == pytest.approx(0.5, rel=1e-3)
    assert found.height.rms == pytest.approx(0.2, rel=1e-6)
    assert found.heading.rms == pytest.approx(0.01, rel=1e-6)
    assert found.tilt.rms == pytest.approx(0.002, rel=1e-2)


def test_turning_about_the_vertical_is_no_tilt() -> None:
    found = cost_between([path(yaw=0.0)], [path(yaw=0.5)])
    assert found.tilt.largest < 1e-7


def test_headings_either_side_of_south_are_close() -> None:
    found = moved(path(yaw=math.pi - 0.01), path(yaw=0.01 - math.pi))
    assert found.heading == pytest.approx(np.full(50, 0.02))


def test_rms_and_largest_are_of_all_drives_and_of_what_is_known() -> None:
    gone = path(north=0.6)
    gone.pos[:25] = np.nan
    found = cost_between([path(), path()], [path(north=0.3), gone])
    assert found.level.largest == pytest.approx(0.6, rel=1e-3)
    rms = math.sqrt((50 * 0.3**2 + 25 * 0.6**2) / 75)
    assert found.level.rms == pytest.approx(rms, rel=1e-3)


@dataclass(frozen=True)
class FakeFit:
    """A fit whose path lies as many metres to the north as its model's values say."""

    model: GapModel
    channel: Any = field(default_factory=lambda: np.array([0, 1, 2]))

    @property
    def north(self) -> float:
        noise = self.model.factors["gyro_bias_walk"] - 1.0
        return sum(v["x"] for v in self.model.values.values()) + noise

    @property
    def held(self) -> HeldPath:
        return path(north=self.north)


@pytest.fixture
def fitted(monkeypatch: pytest.MonkeyPatch) -> list[GapModel]:
    """The models that were fitted, with a fit that takes no time."""
    asked: list[GapModel] = []

    def fit_held_out(
        held_out: Sequence[Any], model: GapModel, values: Any, at: Sequence[Any] = ()
    ) -> list[FakeFit]:
        carried = replace(model, values={**model.values, **values})
        asked.append(carried)
        return [FakeFit(carried) for _ in held_out]

    for module in (confirm, paths):
        monkeypatch.setattr(module, "fit_held_out", fit_held_out)
        monkeypatch.setattr(module, "held_path", lambda fit: fit.held)
    return asked


VALUES: Mapping[str, Mapping[str, float]] = {"a": {"x": 0.25}, "b": {"x": 1.0}}


def test_an_effect_costs_what_the_path_moves_without_it(fitted: list[GapModel]) -> None:
    model = replace(base_model(), values=VALUES)
    final: Any = [FakeFit(model)]
    drives: Any = ["drive"]
    found = costs(drives, final, VALUES, {}, model.factors, {})
    assert found["a"].level.rms == pytest.approx(0.25, rel=1e-3)
    assert found["b"].level.rms == pytest.approx(1.0, rel=1e-3)
    assert [set(m.values) for m in fitted] == [{"b"}, {"a"}]


def test_paths_that_are_known_are_not_fitted_again(fitted: list[GapModel]) -> None:
    model = replace(base_model(), values=VALUES)
    final: Any = [FakeFit(model)]
    drives: Any = ["drive"]
    found = costs(drives, final, VALUES, {}, model.factors, {"a": [path(north=1.0)]})
    assert found["a"].level.rms == pytest.approx(0.25, rel=1e-3)
    assert [set(m.values) for m in fitted] == [{"a"}]


def test_noise_is_compared_with_noise_as_stated(fitted: list[GapModel]) -> None:
    model = base_model()
    noisy = replace(model, factors={**model.factors, "gyro_bias_walk": 4.0})
    final: Any = [FakeFit(noisy)]
    drives: Any = ["drive"]
    noise = {n: noise_levels(n) for n in ("gyro_bias_walk", "gnss_outliers")}
    found = costs(drives, final, {}, noise, model.factors, {})
    assert list(found) == ["gyro_bias_walk"]
    assert found["gyro_bias_walk"].level.rms == pytest.approx(3.0, rel=1e-3)
    assert fitted[0].factors["gyro_bias_walk"] == 1.0
    assert "position_h" in noise_levels("gnss_noise_scale")


def judged(
    monkeypatch: pytest.MonkeyPatch,
    effects: str,
    spoken_against: str = "",
    worsens: str = "",
) -> confirm.Confirmed:
    """The judgement on ``effects`` where held-out data speak against some."""

    def gain(fits: Sequence[FakeFit], without: Sequence[FakeFit], whitener: Any) -> float:
        against = [sum(e in spoken_against for e in f[0].model.values) for f in (fits, without)]
        return 10.0 * (against[1] - against[0])

    def missed(fits: Sequence[FakeFit]) -> Any:
        bad = sum(e in worsens for e in fits[0].model.values)
        return np.full((2, 40), 1.0 + bad)

    monkeypatch.setattr(confirm, "whitener_of", lambda fit: None)
    monkeypatch.setattr(confirm, "gain_over", gain)
    monkeypatch.setattr(confirm, "_missed", missed)
    monkeypatch.setattr(confirm, "_positions", lambda before, after: None)
    drives: Any = ["drive"]
    return confirm.confirmed(drives, base_model(), {e: {"x": 1.0} for e in effects})


def test_what_held_out_data_speak_against_is_told(
    fitted: list[GapModel], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = judged(monkeypatch, "abc", spoken_against="b")
    assert list(found.values) == ["a", "c"]
    assert [(k.effect, k.positions) for k in found.kept_out] == [("b", False)]
    assert found.kept_out[0].nats == pytest.approx(10.0)
    # without a, b was still there: that path is of another model
    assert list(found.without) == ["c"]


def test_what_makes_positions_worse_is_told(
    fitted: list[GapModel], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = judged(monkeypatch, "ab", worsens="b")
    assert list(found.values) == ["a"]
    assert [(k.effect, k.positions) for k in found.kept_out] == [("b", True)]
    assert not found.without


def test_paths_of_effects_that_stand_are_kept(
    fitted: list[GapModel], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = judged(monkeypatch, "ab")
    assert list(found.without) == ["a", "b"]
    assert moved(path(north=1.0), found.without["a"][0]).level.max() < 1e-6
    assert not found.kept_out


def test_gap_json_has_costs_with_units() -> None:
    from automap.gap.result import HeldPositions, KeptOut
    from tests.unit.test_gap_words import COST, result

    told = held_out_json(
        result(
            costs={"a": COST},
            kept_out=(KeptOut("b", True), KeptOut("c", False, 9.0, each_drive=True)),
            positions=HeldPositions((1.0, 0.5), (3.0, 2.0)),
        )
    )
    assert told["costs"]["a"]["level_rms_m"] == 0.32
    assert told["costs"]["a"]["level_max_m"] == 0.61
    assert told["costs"]["a"]["heading_max_deg"] == pytest.approx(math.degrees(4e-3))
    assert told["kept_out"] == [
        {"effect": "b", "positions_worse": True, "nats": 0.0, "each_drive": False},
        {"effect": "c", "positions_worse": False, "nats": 9.0, "each_drive": True},
    ]
    assert told["held_out_positions"]["height_rms_after_m"] == 2.0
    assert held_out_json(result())["held_out_positions"] is None


@pytest.mark.parametrize(("wide", "high"), [(1000.0, 10.0), (10.0, 1000.0), (0.0, 0.0)])
def test_a_plan_has_one_scale_and_shows_everything(wide: float, high: float) -> None:
    x, y = np.array([5.0, 5.0 + wide]), np.array([-7.0, -7.0 + high])
    east, north = _axes([Series("", x, y)])
    scales = [abs(a.end - a.start) / (a.high - a.low) for a in (east, north)]
    assert scales[0] == pytest.approx(scales[1])
    for axis, values in ((east, x), (north, y)):
        assert axis.low <= values.min()
        assert axis.high >= values.max()
    # north is up, and pixels grow downwards
    assert north.start > north.end


def test_a_plan_keeps_the_order_of_a_path_that_crosses_itself() -> None:
    around = np.linspace(0.0, 4.0 * np.pi, 4000)
    drawn = draw_plan("plan", [Series("path", np.cos(around), np.sin(around), "line", 0)])
    points = drawn[0].svg.split('class="l c0" d="M')[1].split('"')[0].split("L")
    pixels = np.array([[float(v) for v in p.split()] for p in points])
    steps = np.hypot(*np.diff(pixels, axis=0).T)
    assert steps.max() < 2.0
    # twice round
    assert steps.sum() == pytest.approx(2.0 * np.pi * np.ptp(pixels[:, 0]), rel=0.02)
    assert draw_plan("nothing", [Series("", np.zeros(0), np.zeros(0))]) == []
