"""Settings of the fuse stage."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, NonNegativeFloat, PositiveFloat, field_validator

from automap.fusion.options import DEFAULT_EFFECTS, FusionOptions
from pipeline.settings.section import Section

_D = FusionOptions()


class FuseSettings(Section):
    """Section ``[fuse]`` of the configuration."""

    effects: tuple[str, ...] = DEFAULT_EFFECTS
    """Effects that are estimated, by name."""
    prior_sd: dict[str, dict[str, PositiveFloat]] = Field(default_factory=dict)
    """One sigma of parameters before the drive: effect, parameter ("*" for all)."""
    fixed: dict[str, dict[str, float]] = Field(default_factory=dict)
    """Effects with known values: effect, parameter, value."""
    accel_noise: PositiveFloat = _D.accel_noise
    """White noise of the accelerometer in a car, m/s^2/sqrt(Hz)."""
    gyro_noise: PositiveFloat = _D.gyro_noise
    """White noise of the gyro in a car, rad/s/sqrt(Hz)."""
    accel_bias_walk: NonNegativeFloat = _D.accel_bias_walk
    """In-run drift of the accelerometer bias, m/s^2/sqrt(s)."""
    gyro_bias_walk: NonNegativeFloat = _D.gyro_bias_walk
    """In-run drift of the gyro bias, rad/s/sqrt(s)."""
    wander_tau_s: PositiveFloat = _D.wander_tau_s
    """Correlation time of the receiver's position error, s."""
    wander_share: NonNegativeFloat = _D.wander_share
    """Wandering position error as a share of the receiver's accuracy figure."""
    white_share: PositiveFloat = _D.white_share
    """White position error as a share of the receiver's accuracy figure."""
    horizontal_sd_m: PositiveFloat = _D.horizontal_sd_m
    """Horizontal error per axis at HDOP 1 where the receiver gives none, m."""
    vertical_sd_m: PositiveFloat = _D.vertical_sd_m
    """Vertical error at HDOP 1 where the receiver gives none, m."""
    velocity_sd: PositiveFloat = _D.velocity_sd
    """Velocity error per axis where the receiver gives none, m/s."""
    velocity_wander_sd: NonNegativeFloat = _D.velocity_wander_sd
    """The part of the velocity error that wanders, m/s; 0 for none."""
    velocity_wander_tau_s: PositiveFloat = _D.velocity_wander_tau_s
    """Correlation time of that part, s."""
    shocks: bool = _D.shocks
    """Whether noise is larger where readings scatter much from sample to sample."""
    nhc_sd: PositiveFloat = _D.nhc_sd
    """Sideways speed of the vehicle over one second, m/s."""
    nhc_slip: NonNegativeFloat = _D.nhc_slip
    """The same per lateral acceleration, (m/s)/(m/s^2)."""
    nhc_min_speed: PositiveFloat = _D.nhc_min_speed
    """The vehicle constraint holds above this speed, m/s."""
    odometer_sd: PositiveFloat = _D.odometer_sd
    """Wheel speed over one second, m/s."""
    zero_velocity_sd: PositiveFloat = _D.zero_velocity_sd
    """Speed left at standstill over one second, m/s."""
    zero_rate_sd: PositiveFloat = _D.zero_rate_sd
    """Turn rate left at standstill over one second, rad/s."""
    gate_probability: Annotated[float, Field(gt=0, lt=0.5)] = _D.gate_probability
    """Share of good measurements that are trusted less on first sight."""
    passes: Annotated[int, Field(ge=2, le=20)] = _D.passes
    """Passes at most until the delays have settled."""
    iterations: Annotated[int, Field(ge=0, le=20)] = _D.iterations
    """Iterations of the smoother about its own result."""
    adapt: bool = _D.adapt
    """Correct the white noise levels by the drive's own innovations."""
    tune: bool = _D.tune
    """Find all noise levels by likelihood, finely; the command line's --tune."""
    factors: dict[str, PositiveFloat] = Field(default_factory=dict)
    """Factors on the noise levels, as --tune writes them."""
    earth_rotation: bool = _D.earth_rotation
    """The Earth turns under the sensor."""
    imu_delay_sd_s: PositiveFloat = 0.05
    """IMU stamps against a clock shared with the receiver, s."""

    stated: tuple[str, ...] = ()
    """Settings of this section that a preset of sensor or receiver leaves as they are; those of
    ``--config`` and ``--set`` are added."""

    @field_validator("factors")
    @classmethod
    def _levels_exist(cls, value: dict[str, float]) -> dict[str, float]:
        from automap.fusion.levels import ALL_LEVELS

        wrong = sorted(set(value) - set(ALL_LEVELS))
        if wrong:
            raise ValueError(f"no noise level '{wrong[0]}'; there are " + ", ".join(ALL_LEVELS))
        return value

    def options(self) -> FusionOptions:
        """The library's form of these settings."""
        values = self.model_dump(exclude={"imu_delay_sd_s", "stated"})
        return FusionOptions(**values)
