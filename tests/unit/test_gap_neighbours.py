"""Formulas near one that was found: which there are, and that the likeliest of them is told."""

from __future__ import annotations

import re
from collections.abc import Sequence
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from automap.effects.formula_text import parse_formula
from automap.effects.signals import FIELDS, Signals
from automap.gap import forms
from automap.gap.dictionary import formula_terms
from automap.gap.forms import About
from automap.gap.neighbours import Terms, amounts, as_turn, neighbours

if TYPE_CHECKING:
    from automap.gap.linear import Conditional


@pytest.fixture(scope="module")
def signals() -> Signals:
    rng = np.random.default_rng(1)
    walks = {name: rng.normal(size=400) for name in FIELDS}
    walks |= {"time": np.arange(400.0), "speed": 5.0 + np.abs(rng.normal(size=400))}
    return Signals(**walks)


def test_a_factor_is_bent_remembered_one_sided_and_left_out(signals: Signals) -> None:
    near = neighbours("speed * acceleration", signals)
    for text in (
        "speed * min(acceleration, 0)",
        "speed * abs(acceleration)",
        "speed * lag(acceleration, 1.0)",
        "speed^2 * acceleration",
        "speed * force_x",
        "acceleration",
    ):
        assert text in near
    assert any(
        re.fullmatch(r"rate_z \* step\([\d.]+ - speed\)", t)
        for t in neighbours("rate_z * speed", signals)
    )
    # a speed has one sign
    assert not any("abs(speed)" in text for text in near)
    assert "(rate_z * abs(rate_z))" in neighbours("rate_z^3", signals)
    assert "abs(rate_z) * speed" in neighbours("abs(rate_z)", signals)


@pytest.mark.slow
def test_the_formulas_near_any_of_the_dictionary_are_others_and_can_be_read(
    signals: Signals,
) -> None:
    for _, text in dict.fromkeys(formula_terms(signals, True)):
        near = [*neighbours(text, signals), *amounts(text)]
        assert text not in near
        assert len(set(near)) == len(near)
        for other in near:
            assert parse_formula(other)(signals).shape == signals.time.shape


def test_a_form_is_compared_with_the_amounts_that_suit_it(monkeypatch: pytest.MonkeyPatch) -> None:
    t = np.arange(0.0, 400.0, 0.2)
    speed = np.clip(8.0 + 9.0 * np.sin(t / 17.0) + 4.0 * np.sin(t / 5.3), 0.0, None)
    zero = {name: np.zeros_like(t) for name in FIELDS}
    along = Signals(**{**zero, "time": t, "speed": speed})
    truth = parse_formula("max(speed - 6.4, 0)")(along)

    def left(text: str) -> float:
        # beside a constant and a scale
        columns = np.stack([np.ones_like(t), speed, parse_formula(text)(along)], axis=1)
        return float(
            np.sum((truth - columns @ np.linalg.lstsq(columns, truth, rcond=None)[0]) ** 2)
        )

    def ranked(about: Any, tried: Sequence[Terms], price: Any, *alike: float) -> list[Terms]:
        return sorted(tried, key=lambda terms: left(terms[0][1]))

    monkeypatch.setattr(forms, "ranked", ranked)
    near, _ = forms.nearby(cast("About", None), along, (("velocity_along", "tanh(speed / 5.0)"),))
    # beside a scale what counts below a speed is what counts above it
    bends = [
        float(x)
        for ((_, text),), _ in near
        for x in re.findall(r"^max\(\(?(?:speed - )?([\d.]+)(?: - speed)?\)?, 0\)", text)
    ]
    assert any(abs(at - 6.4) < 0.5 for at in bends)


def test_forms_that_data_do_not_tell_from_a_likelier_one_are_not_asked_about() -> None:
    # the second explains all but a thousandth of what the first does, the third a quarter of it
    info = np.array([[1.0, 0.9995, 0.5], [0.9995, 1.0, 0.5], [0.5, 0.5, 1.0]])

    def different(nats: float, alike: float = 3.0) -> set[Any]:
        known = SimpleNamespace(
            info=lambda part: info[np.ix_(part, part)],
            score=np.sqrt(2.0 * nats) * np.array([1.0, 1.0, 0.5]),
        )
        return forms._different(cast("Conditional", known), [(0,), (1,), (2,)], alike)

    assert different(100.0) == {(0,), (2,)}
    assert different(10000.0) == {(0,), (1,), (2,)}
    # an amount is where it is likeliest to half a nat
    assert different(1000.0, 0.5) == {(0,), (1,), (2,)}
    # what shows nothing is not told from what comes before it, and is no division by nothing
    info[1:] = info[:, 1:] = 0.0
    with np.errstate(all="raise"):
        assert (0,) in different(100.0)


def test_what_is_remembered_takes_a_shape_and_a_shape_is_remembered(signals: Signals) -> None:
    near = neighbours("abs(jerk_x)", signals)
    assert "abs(lag(jerk_x, 0.3))" in near
    assert "lag(abs(jerk_x), 0.3)" in near
    assert "speed * max(lag(force_x, 1.0), 0)" in neighbours("speed * max(force_x, 0)", signals)


def test_what_has_both_signs_counts_beyond_a_size_to_one_side_and_to_both(
    signals: Signals,
) -> None:
    near = [re.sub(r"\d+\.\d+", "a", text) for text in neighbours("rate_z", signals)]
    for text in ("max(rate_z - a, 0)", "min(rate_z + a, 0)", "max(abs(rate_z) - a, 0)"):
        assert text in near
    # where a shape begins is moved as any amount
    assert "max(abs(rate_z) - 0.2, 0)" in amounts("max(abs(rate_z) - 0.1, 0)")


def test_a_shape_takes_the_place_of_another(signals: Signals) -> None:
    near = neighbours("tanh(rate_z / 0.01)", signals)
    assert "abs(rate_z)" in near
    assert not any("abs(tanh" in text for text in near)


def test_amounts_are_moved_and_whole_numbers_stay() -> None:
    moved = amounts("speed * lag(acceleration, 2.0)")
    widths = [float(text.rpartition(", ")[2].rstrip(")")) for text in moved]
    assert min(widths) == pytest.approx(0.5)
    assert max(widths) == pytest.approx(8.0)
    assert amounts("sin(2 * heading) * speed^3") == []
    # where both ends of a dead zone are, it is moved at both
    zone = amounts("(rate_z - min(max(rate_z, -0.1), 0.1))")
    assert "(rate_z - min(max(rate_z, -0.2), 0.2))" in zone


def test_what_is_remembered_has_shapes_and_no_second_memory(signals: Signals) -> None:
    near = neighbours("lag(force_y, 0.5)", signals)
    assert any(text.startswith("tanh(lag(force_y, 0.5) / ") for text in near)
    assert "max(lag(force_y, 0.5), 0)" in near
    assert not any("lag(lag(" in text or "lag((lag(" in text for text in near)
    # with what it leaves, and with neither
    near = neighbours("lag(step(6 - speed), 20.0)", signals)
    assert "(step(6 - speed) - lag(step(6 - speed), 20.0))" in near
    assert "step(6 - speed)" in near
    assert "lag(force_y, 0.5)" in neighbours("(force_y - lag(force_y, 0.5))", signals)
    # a play is one shape already
    assert not any("tanh(" in text for text in neighbours("play(force_y, 0.5)", signals))


@pytest.mark.parametrize(
    ("on", "text", "turn"),
    [
        ("gyro_z", "lag(jerk_y, 1.0)", (("imu_yaw", "lag(force_y, 1.0)"),)),
        ("gyro_y", "angular_acceleration_x", (("imu_pitch", "rate_x"),)),
        # these read no change, or no turn
        ("gyro_z", "force_y", ()),
        ("accel_y", "jerk_y", ()),
    ],
)
def test_a_gyro_that_reads_a_change_is_much_as_a_unit_that_turns(
    on: str, text: str, turn: Terms
) -> None:
    assert as_turn(on, text) == turn


def test_a_unit_that_turns_is_among_the_forms_of_what_its_gyro_reads(
    monkeypatch: pytest.MonkeyPatch, signals: Signals
) -> None:
    monkeypatch.setattr(forms, "ranked", lambda about, tried, *price: list(tried))
    near, _ = forms.nearby(cast("About", None), signals, (("gyro_z", "jerk_y"),))
    told = dict(near)
    assert (("imu_yaw", "force_y"),) in told
    # both channels are paid for
    bent = next(terms for terms in told if terms[0][0] == "gyro_z")
    assert told[as_turn(*bent[0])] == 2 * told[bent]
