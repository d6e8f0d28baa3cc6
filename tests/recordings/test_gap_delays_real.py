"""Late velocities of a real car: the delay is found from wherever the search begins."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from automap.fusion.options import FusionOptions
from automap.gap.drive import in_vehicle_axes, open_drive
from automap.gap.fit import fit_drive
from automap.gap.noise import Fitted, with_noise
from pipeline.gap.inputs import gap_drives, gap_model
from tests.unit.gap_values import value_of

LAG = "gnss_velocity_lag"


@pytest.mark.slow
@pytest.mark.parametrize("start", [0.05, 0.7])
def test_a_lag_is_found_from_far_beyond_it(shared_data: Path, tmp_path: Path, start: float) -> None:
    """Differences of positions 0.25 s apart, 0.131 s old. Under noise that suits a lag of 0.7 s,
    what changes quickly tells most: there the acceleration at a fix's tag has the wrong sign."""
    model, settings = gap_model(None)
    (drive,) = gap_drives([shared_data / "drives" / "rtk-car-a"], tmp_path / "runs", settings)
    drive = in_vehicle_axes(drive.part(0.0, 180.0, "rtk-car-a"), FusionOptions())
    opened = open_drive(drive, model.options)
    wrong = replace(model, values={**model.values, LAG: {"tau": start}})
    for _ in range(2):
        # the noise that suits what was found, and then what suits that noise, as a search has it
        far = with_noise(Fitted(wrong, {}, (fit_drive(opened, wrong),)), model.factors)
        noisy = replace(model, factors=far.model.factors)
        found = fit_drive(opened, noisy, {LAG: 1.0}, linearised_at=far.fits[0])
        wrong = replace(model, values={**model.values, LAG: value_of(found, LAG)})
    assert value_of(found, LAG)["tau"] == pytest.approx(0.131, abs=0.02)
