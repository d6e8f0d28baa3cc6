"""What may be set about a fusion run: the one place of names, defaults, limits, units.

The application's section ``[fuse]`` and ``configs/default.toml`` are made of it: the text below
a field is its comment there. What is no setting of a run stands last.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from pydantic import Field, NonNegativeFloat, PositiveFloat

from automap.effects.limits import NOSE_SLIP_DEG

DEFAULT_EFFECTS = (
    "accel_bias",
    "gyro_bias",
    "accel_scale",
    "gyro_scale",
    "accel_misalignment",
    "gyro_misalignment",
    "imu_time_offset",
    "gnss_velocity_latency",
    "gnss_course_latency",
    "gnss_velocity_scale",
    "gnss_correlated_noise",
    "gnss_multipath",
    "imu_mounting",
    "nhc_lever_arm",
    "vehicle_pitch",
)


@dataclass(frozen=True)
class FusionOptions:
    """Noise figures, priors and switches of the fusion, SI units.

    White noise includes what vibration the sampling folds down. In ``prior_sd`` the parameter "*"
    stands for all of an effect, in ``fixed`` parameters that are not named are zero. ``wander_*``
    are the Gauss-Markov part of a fix's error relative to the receiver's own accuracy figure, for
    ``shocks`` see ``shock_noise``, for ``factors`` see ``levels``.
    """

    effects: tuple[str, ...] = DEFAULT_EFFECTS
    """estimated effects, by name"""
    prior_sd: Mapping[str, Mapping[str, PositiveFloat]] = field(default_factory=dict)
    """one sigma before the drive: { effect = { parameter = sd } } in the effect's unit"""
    fixed: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """known values: { effect = { parameter = value } } in the effect's unit, not estimated"""
    accel_noise: PositiveFloat = 0.01
    """m/s^2/sqrt(Hz), white noise of the accelerometer in a car"""
    gyro_noise: PositiveFloat = 4e-4
    """rad/s/sqrt(Hz), white noise of the gyro in a car"""
    accel_bias_walk: NonNegativeFloat = 4e-4
    """m/s^2/sqrt(s), in-run drift"""
    gyro_bias_walk: NonNegativeFloat = 1e-5
    """rad/s/sqrt(s), in-run drift"""
    wander_tau_s: PositiveFloat = 60.0
    """s, correlation time of the receiver's slow position error"""
    wander_share: PositiveFloat = 0.8
    """share of the receiver's accuracy figure that wanders slowly"""
    multipath_tau_s: PositiveFloat = 10.0
    """s, correlation time of the receiver's quick position error"""
    multipath_share: NonNegativeFloat = 0.3
    """share of the receiver's accuracy figure that lasts for seconds; 0: none"""
    bias_share: NonNegativeFloat = 0.45
    """share of the receiver's accuracy figure that outlasts what a drive can tell"""
    white_share: PositiveFloat = 0.25
    """share of the receiver's accuracy figure that is white"""
    horizontal_sd_m: PositiveFloat = 1.0
    """m per axis at HDOP 1, where the receiver gives no accuracy"""
    vertical_sd_m: PositiveFloat = 2.0
    """m at HDOP 1, where the receiver gives no accuracy"""
    common_horizontal_sd_m: NonNegativeFloat = 0.7
    """m per axis that satellites have in common, whatever the HDOP; a path of fixes without
    corrections is nowhere surer, whatever they state"""
    common_vertical_sd_m: NonNegativeFloat = 3.0
    """m of height that satellites and the model of sea level have in common"""
    velocity_sd: PositiveFloat = 0.1
    """m/s per axis, where the receiver gives no accuracy"""
    velocity_wander_sd: NonNegativeFloat = 0.2
    """m/s, the part of the velocity error that lasts; 0: none"""
    velocity_wander_tau_s: PositiveFloat = 4.0
    """s, its correlation time"""
    shocks: bool = False
    """larger noise where readings scatter much from sample to sample"""
    nhc_sd: PositiveFloat = 0.04
    """m/s, sideways speed of the vehicle over one second, driving straight"""
    nhc_slip: NonNegativeFloat = 0.03
    """(m/s)/(m/s^2), the same per lateral acceleration"""
    nhc_lasting_deg: NonNegativeFloat = NOSE_SLIP_DEG
    """deg, by which a nose is off its course for minutes: camber, side wind, axles out of line"""
    nhc_min_speed: PositiveFloat = 3.0
    """m/s, the vehicle constraint holds above this speed"""
    nhc_mean_s: NonNegativeFloat = 4.0
    """s, over which a body on its springs goes as far up as down; 0: it does so at every instant"""
    odometer_sd: PositiveFloat = 0.05
    """m/s, wheel speed over one second, where the drive has it"""
    zero_velocity_sd: PositiveFloat = 0.03
    """m/s, speed left at standstill over one second"""
    zero_rate_sd: PositiveFloat = 1e-3
    """rad/s, turn rate left at standstill over one second"""
    gate_probability: Annotated[float, Field(gt=0, lt=0.5)] = 1e-3
    """share of good measurements that are trusted less on first sight"""
    passes: Annotated[int, Field(ge=2, le=20)] = 6
    """passes at most until the delays have settled"""
    iterations: Annotated[int, Field(ge=0, le=20)] = 1
    """iterations of the smoother about its own result"""
    adapt: bool = True
    """correct the white noise levels by the drive's own innovations"""
    tune: bool = False
    """find all noise levels by likelihood, finely; as --tune does"""
    factors: Mapping[str, PositiveFloat] = field(default_factory=dict)
    """factors on the noise levels, as --tune writes them"""
    earth_rotation: bool = True
    """the Earth turns under the sensor"""
    retime: bool = True
    """ages of fixes move the nodes; without it only the IMU's delay does"""
    min_position_sd_m: float = 0.01
    """m, no position is taken to be better"""
    min_velocity_sd: float = 0.03
    """m/s, no velocity is taken to be better"""
    gap_factor: float = 2.5
    """multiples of the median step between IMU stamps: longer is a gap"""
    gap_force_sd: float = 1.0
    """m/s^2, one sigma of the specific force inside a gap of the samples, at most"""
    gap_rate_sd: float = 0.1
    """rad/s, one sigma of the turn rate inside a gap of the samples, at most"""
