"""What may be set about a fusion run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

DEFAULT_EFFECTS = (
    "accel_bias",
    "gyro_bias",
    "accel_scale",
    "gyro_scale",
    "imu_time_offset",
    "gnss_velocity_latency",
    "gnss_correlated_noise",
    "imu_mounting",
    "nhc_lever_arm",
)


@dataclass(frozen=True)
class FusionOptions:
    """Noise figures, priors and switches of the fusion, SI units.

    ``accel_noise`` m/s^2/sqrt(Hz), ``gyro_noise`` rad/s/sqrt(Hz): white noise including what
    vibration the sampling folds down. ``prior_sd`` replaces catalogue priors: effect ->
    parameter -> sd (parameter "*" for all). ``fixed``: effects that are not estimated but have
    these values (parameters not named are zero). ``wander_tau_s`` and ``wander_share``: the
    Gauss-Markov part of a fix's error relative to the receiver's own accuracy figure,
    ``white_share`` the white part. ``velocity_wander_sd`` m/s and ``velocity_wander_tau_s`` the
    Gauss-Markov part of its velocity's error, none with 0; with ``shocks`` noise is larger
    where readings scatter much (``shock_noise``). With ``calm_rates`` lever arms take turn rates
    without the noise of single readings, where delays are told too: a velocity whose age nobody
    knows makes an arm of its own. ``passes`` at most that many to settle the
    delays, ``iterations`` of the smoother about its own result after that. With
    ``adapt`` the white levels are starting values that the drive's own innovations correct, with
    ``tune`` all levels, finely; ``factors`` on the levels are where that begins (see
    ``levels``).
    Without ``retime``
    only the IMU's delay moves the nodes; ages of fixes stay states, and the nodes stay the same.
    """

    effects: tuple[str, ...] = DEFAULT_EFFECTS
    prior_sd: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    fixed: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    accel_noise: float = 0.01
    gyro_noise: float = 4e-4
    accel_bias_walk: float = 4e-4
    gyro_bias_walk: float = 1e-5
    wander_tau_s: float = 60.0
    wander_share: float = 1.0
    white_share: float = 0.25
    velocity_wander_sd: float = 0.0
    velocity_wander_tau_s: float = 2.0
    shocks: bool = False
    calm_rates: bool = False
    horizontal_sd_m: float = 1.2
    vertical_sd_m: float = 2.4
    velocity_sd: float = 0.1
    min_position_sd_m: float = 0.01
    min_velocity_sd: float = 0.03
    nhc_sd: float = 0.04
    nhc_slip: float = 0.03
    nhc_min_speed: float = 3.0
    odometer_sd: float = 0.05
    zero_velocity_sd: float = 0.03
    zero_rate_sd: float = 0.001
    gap_factor: float = 2.5
    gap_force_sd: float = 1.0
    gap_rate_sd: float = 0.1
    gate_probability: float = 1e-3
    passes: int = 6
    iterations: int = 1
    adapt: bool = True
    tune: bool = False
    factors: Mapping[str, float] = field(default_factory=dict)
    earth_rotation: bool = True
    retime: bool = True
