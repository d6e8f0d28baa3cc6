"""Settings of the fuse stage."""

from __future__ import annotations

from pydantic import PositiveFloat, field_validator

from automap.fusion.options import FusionOptions
from pipeline.settings.section import Section, of_options

_OF_THE_LIBRARY = (
    *("retime", "min_position_sd_m", "min_velocity_sd", "nhc_mean_s"),
    *("gap_factor", "gap_force_sd", "gap_rate_sd"),
)
"""Options that are no settings of a run."""


@of_options(FusionOptions, but=_OF_THE_LIBRARY)
class FuseSettings(Section):
    """Section ``[fuse]`` of the configuration: the fusion's options, and what comes before it."""

    imu_delay_sd_s: PositiveFloat = 0.05
    """s, one sigma of IMU stamps against a clock shared with the receiver"""
    stated: tuple[str, ...] = ()
    """names of settings above that a preset (sensor, receiver) leaves alone; those of --config
    and --set are added"""

    @field_validator("factors", check_fields=False)
    @classmethod
    def _levels_exist(cls, value: dict[str, float]) -> dict[str, float]:
        from automap.fusion.levels import ALL_LEVELS

        wrong = sorted(set(value) - set(ALL_LEVELS))
        if wrong:
            raise ValueError(f"no noise level '{wrong[0]}'; there are " + ", ".join(ALL_LEVELS))
        return value

    def options(self) -> FusionOptions:
        """The library's form of these settings."""
        return FusionOptions(**self.model_dump(exclude={"imu_delay_sd_s", "stated"}))
