"""When held-out positions are predicted worse, and when a difference is chance."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from automap.fusion.layout import CH_POS, CH_VEL
from automap.gap import confirm, limits
from automap.gap.confirm import confirmed
from automap.gap.drive import OpenDrive
from automap.gap.fit import Fit, Values, base_model
from automap.records import FloatArray

LENGTH_S = 400.0
STRETCHES = int(LENGTH_S / limits.BLOCKS_S[0])


def fit_with(errors: FloatArray, velocities: float = 1.0) -> Fit:
    """A fit that predicts positions, one a second, with these errors [n, 3], m."""
    n = len(errors)
    t = np.linspace(0.0, LENGTH_S, n)
    node = np.repeat(np.arange(n), 4)
    channel = np.tile([CH_POS, CH_POS + 1, CH_POS + 2, CH_VEL], n)
    nu = np.column_stack([errors, np.full(n, velocities)]).ravel()
    store = SimpleNamespace(info=np.column_stack([node, channel]), nu=nu)
    last = SimpleNamespace(forward=SimpleNamespace(store=store), nodes=SimpleNamespace(t=t))
    return cast("Fit", SimpleNamespace(last=last))


def errors(seed: int = 1) -> FloatArray:
    return np.random.default_rng(seed).standard_normal((401, 3)) * [1.0, 1.0, 2.0]


def worse(after: FloatArray, before: FloatArray) -> bool:
    return confirm._worse([fit_with(after)], [fit_with(before)])


@pytest.mark.parametrize(
    ("factor", "told"), [(0.9, False), (1.0, False), (1.01, False), (1.05, True), (1.5, True)]
)
def test_positions_that_err_more_everywhere_are_worse(factor: float, told: bool) -> None:
    before = errors()
    assert worse(factor * before, before) is told


@pytest.mark.parametrize("axes", [slice(0, 2), slice(2, 3)], ids=["level", "down"])
def test_either_of_level_and_height_is_enough(axes: slice) -> None:
    before = errors()
    after = 0.9 * before
    after[:, axes] = 1.1 * before[:, axes]
    assert worse(after, before)


def test_one_bad_stretch_is_chance() -> None:
    before = errors()
    after = before.copy()
    after[100:108] *= 2.0
    assert np.mean(after[:, :2] ** 2) > 1.03 * np.mean(before[:, :2] ** 2)
    assert not worse(after, before)


def test_differences_that_come_and_go_are_chance() -> None:
    # as likely better as worse, stretch by stretch
    told = [worse(errors(seed), errors(seed + 100)) for seed in range(40)]
    assert sum(told) <= 1


def test_wild_positions_count_by_their_size_and_no_more() -> None:
    before = errors()
    after = before.copy()
    after[::80, 0] = 20.0
    missed = [confirm._missed([fit_with(e)]).sum(axis=1) for e in (after, before)]
    assert 1.1 * missed[1][0] < missed[0][0] < 2.0 * missed[1][0]
    assert not worse(after, before)


def test_what_is_missed_is_summed_by_stretches_level_and_down() -> None:
    flat = np.zeros((401, 3))
    flat[:, 2] = 0.5
    missed = confirm._missed([fit_with(flat, velocities=9.0)] * 2)
    assert missed.shape == (2, 2 * STRETCHES)
    assert not missed[0].any()
    assert missed[1].sum() == pytest.approx(2 * 401 * 0.125)


def held(monkeypatch: pytest.MonkeyPatch, score: dict[str, float], level: dict[str, float]) -> None:
    """Held-out data on which each effect changes the score, nats, and the errors, by a factor."""

    def fit_held_out(opened: object, model: object, values: Values, *about: object) -> list[Fit]:
        size = float(np.prod([level[e] for e in values]))
        fit = fit_with(size * errors())
        vars(fit)["score"] = sum(score[e] for e in values)
        return [fit]

    monkeypatch.setattr(confirm, "fit_held_out", fit_held_out)
    monkeypatch.setattr(confirm, "held_path", lambda fit: None)
    monkeypatch.setattr(confirm, "whitener_of", lambda fit: None)
    monkeypatch.setattr(confirm, "gain_over", lambda a, b, whitener: a[0].score - b[0].score)


DRIVE = cast("OpenDrive", SimpleNamespace())
VALUES = {"gyro_scale": {"z": 0.01}, "gnss_latency": {"s": 0.1}, "gnss_lever_arm": {"x": 0.5}}


def test_what_held_out_data_speak_against_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    score = {"gyro_scale": 50.0, "gnss_latency": -20.0, "gnss_lever_arm": -1.0}
    held(monkeypatch, score, dict.fromkeys(VALUES, 0.9))
    found = confirmed([DRIVE], base_model(), VALUES)
    # a nat against one is what a right effect's value may cost
    assert list(found.values) == ["gyro_scale", "gnss_lever_arm"]
    assert len(found.warnings) == 1
    assert found.warnings[0].startswith("gnss_latency")
    assert "20 nats" in found.warnings[0]


def test_a_formula_must_be_borne_out(monkeypatch: pytest.MonkeyPatch) -> None:
    score = {"gyro_scale": 50.0, "gnss_latency": -1.0, "gnss_lever_arm": -1.0}
    held(monkeypatch, score, dict.fromkeys(VALUES, 0.9))
    found = confirmed([DRIVE], base_model(), VALUES, must_gain=["gnss_lever_arm"])
    assert list(found.values) == ["gyro_scale", "gnss_latency"]
    assert [one.effect for one in found.kept_out] == ["gnss_lever_arm"]


def test_what_makes_positions_worse_is_dropped_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    level = {"gyro_scale": 0.95, "gnss_latency": 1.2, "gnss_lever_arm": 1.0}
    held(monkeypatch, dict.fromkeys(VALUES, 30.0), level)
    found = confirmed([DRIVE], base_model(), VALUES)
    assert list(found.values) == ["gyro_scale", "gnss_lever_arm"]
    assert "gnss_latency" in found.warnings[0]


def test_without_held_out_data_all_stands() -> None:
    found = confirmed([], base_model(), VALUES)
    assert found.values == VALUES
    assert found.warnings == ()
