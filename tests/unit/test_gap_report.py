"""The plots of gap.html: measurement and simulation, spectra, error bars."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from automap.gap import base_model
from automap.gap.costs import cost_between, held_path
from automap.gap.drive import open_drive
from automap.gap.fit import Fit, fit_drive
from automap.gap.noise import Fitted, with_noise
from automap.gap.result import p_text
from pipeline.gap.path_plots import path_plots
from pipeline.gap.plots import _spectrum, error_bars, overlay, running, spectrum
from tests.unit.test_gap import simulated

ARM = {"gnss_lever_arm": {"x": 0.0, "y": 0.6, "z": 0.0}}


@pytest.fixture(scope="module")
def fits() -> tuple[Fit, Fit]:
    """A drive with a lever arm, under the model without it and with it, noise as it is."""
    model = base_model()
    opened = open_drive(simulated(ARM), model.options)
    armed = replace(model, values=ARM)
    fitted = with_noise(Fitted(armed, {}, (fit_drive(opened, armed),)), model.factors)
    after = fitted.fits[0]
    return fit_drive(opened, replace(fitted.model, values={}), linearised_at=after), after


@pytest.mark.slow
def test_a_right_model_has_a_flat_spectrum_and_the_wrong_one_more_power(
    fits: tuple[Fit, Fit],
) -> None:
    powers = []
    for fit in fits:
        found = _spectrum(fit, "velocity_n")
        assert found is not None
        powers.append(found[1])
    assert np.mean(powers[1]) == pytest.approx(1.0, abs=0.25)
    # in bends: slow
    assert powers[0][:6].mean() > 2.5 * powers[1][:6].mean()


@pytest.mark.parametrize("name", ["velocity_n", "velocity_e"])
def test_every_plot_says_what_its_lines_are(fits: tuple[Fit, Fit], name: str) -> None:
    drawn = overlay(*fits, name, "m/s") + running(*fits, name) + spectrum(*fits, name)
    assert [len(p.legend) for p in drawn] == [3, 2, 3]
    for plot in drawn:
        assert plot.svg.startswith("<svg")
        assert "nan" not in plot.svg


def test_what_is_not_measured_is_not_drawn(fits: tuple[Fit, Fit]) -> None:
    assert overlay(*fits, "odometer", "m/s") == []
    assert spectrum(*fits, "odometer") == []


def test_error_bars_are_of_position_and_heading(fits: tuple[Fit, Fit]) -> None:
    titles = [p.title for p in error_bars(*fits)]
    assert len(titles) == 2
    assert "position" in titles[0]
    assert "heading" in titles[1]


@pytest.mark.parametrize(
    ("p", "told"), [(2e-5, "2e-05"), (3e-80, "below 1e-12"), (0.0, "below 1e-12"), (0.2, "2e-01")]
)
def test_a_p_value_far_out_is_told_as_a_bound(p: float, told: str) -> None:
    assert p_text(p) == told


def test_the_path_is_shown_from_above_whole_and_close_and_what_differs_along_time(
    fits: tuple[Fit, Fit],
) -> None:
    plots = path_plots(*fits)
    titles = [p.title for p in plots]
    assert ["level" in t for t in titles] == [False, False, True, False, False]
    assert "above" in titles[0]
    assert "furthest apart" in titles[1]
    for plot in plots[:2]:
        assert {label for label, _ in plot.legend} == {"old model", "new model", "fixes"}
        assert "nan" not in plot.svg


def test_a_path_without_the_arm_is_off_by_it(fits: tuple[Fit, Fit]) -> None:
    before, after = (held_path(fit) for fit in fits)
    found = cost_between([after], [before])
    # positions and velocities pull the IMU to where the antenna is, as far as the bends allow
    assert 0.3 < found.level.rms < 0.7
    assert found.height.rms < 0.2
    assert cost_between([after], [after]).level.largest == 0.0
