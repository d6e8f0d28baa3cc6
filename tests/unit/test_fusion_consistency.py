"""The verdict on the innovations: true, and in words."""

from __future__ import annotations

import numpy as np
import pytest

from automap.fusion.consistency import channel_consistency, verdict
from automap.fusion.output import Innovations


def _table(size: float = 1.0, memory: float = 0.0, n: int = 600) -> Innovations:
    """Innovations of three channels; position's are ``size`` times their sd, and remember."""
    rng = np.random.default_rng(4)
    parts = []
    for name in ("position_n", "velocity_e", "nhc_y"):
        noise = rng.standard_normal(n)
        if name == "position_n":
            for i in range(1, n):
                noise[i] = memory * noise[i - 1] + np.sqrt(1.0 - memory**2) * noise[i]
            noise *= size
        if name == "nhc_y":
            noise *= 0.1
        parts.append((name, 2.0 * noise))
    return Innovations(
        np.tile(np.arange(n), 3),
        np.repeat(np.array([name for name, _ in parts], dtype=object), n),
        np.concatenate([values for _, values in parts]),
        np.full(3 * n, 2.0),
        np.ones(3 * n),
        np.ones(3 * n, dtype=bool),
    )


def test_channels_are_measured() -> None:
    channels = channel_consistency(_table(size=2.0, memory=0.6))
    assert channels["position_n"].normalised_rms == pytest.approx(2.0, rel=0.1)
    assert channels["position_n"].lag1 == pytest.approx(0.6, abs=0.1)
    assert channels["velocity_e"].lag1 == pytest.approx(0.0, abs=0.1)


def test_a_good_filter_is_told_with_its_figures() -> None:
    said = verdict(channel_consistency(_table()))
    assert said.startswith("the innovations are about as large as the filter expects (")
    assert " to 1.0" in said or " to 0.9" in said


@pytest.mark.parametrize(
    ("size", "memory", "words"),
    [
        (2.0, 0.0, "innovations of position north scatter 2.0"),
        (0.3, 0.0, "innovations of position north scatter only 0.3"),
        (1.0, 0.7, "innovations of position north resemble each other (correlation 0."),
    ],
)
def test_what_is_wrong_is_told_and_where(size: float, memory: float, words: str) -> None:
    said = verdict(channel_consistency(_table(size, memory)))
    assert words in said
    assert "velocity" not in said
    assert "nhc" not in said


def test_too_few_are_not_judged() -> None:
    assert "too few" in verdict(channel_consistency(_table(n=10)))
