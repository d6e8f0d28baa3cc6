"""How large each hidden error is drawn: log-uniform between barely felt and hard to miss."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

DrawnEffect = dict[str, float]


@dataclass(frozen=True)
class Scale:
    """Natural scale of one effect: magnitudes from ``small`` to ``large`` in the unit of the
    contract. ``parameters`` are the effect's; ``every`` draws all of them, otherwise one to all.
    ``positive`` for quantities that have a sign by nature."""

    parameters: tuple[str, ...]
    small: float
    large: float
    every: bool = False
    positive: bool = False


_XYZ = ("x", "y", "z")
_FULL = tuple(a + b for a in "xyz" for b in "xyz")

SCALES: Mapping[str, Scale] = {
    "accel_misalignment": Scale(("yx", "zx", "zy"), 1e-3, 3e-2),
    "gyro_misalignment": Scale(("xy", "xz", "yx", "yz", "zx", "zy"), 1e-3, 3e-2),
    "accel_scale_asymmetry": Scale(_XYZ, 3e-3, 4e-2),
    "gyro_scale_asymmetry": Scale(_XYZ, 3e-3, 4e-2),
    "accel_quadratic": Scale(_XYZ, 2e-4, 4e-3),
    "gyro_g_sensitivity": Scale(_FULL, 3e-5, 1e-3),
    "accel_temperature": Scale(_XYZ, 1e-3, 2e-2),
    "gyro_temperature": Scale(_XYZ, 1e-5, 4e-4),
    "imu_mounting": Scale(("roll", "pitch", "yaw"), 2e-3, 5e-2, every=True),
    "imu_time_offset": Scale(("s",), 4e-3, 0.15),
    "imu_clock_skew": Scale(("s_per_s",), 5e-5, 3e-3),
    "speed_vibration": Scale(_XYZ, 5e-5, 2e-3),
    "gnss_lever_arm": Scale(_XYZ, 0.05, 1.0, every=True),
    "gnss_latency": Scale(("s",), 5e-3, 0.2, positive=True),
    "gnss_velocity_latency": Scale(("s",), 0.01, 0.2, positive=True),
    "gnss_velocity_lag": Scale(("s",), 0.02, 0.4, positive=True),
    "vehicle_sideslip": Scale(("k",), 1e-3, 1.2e-2, positive=True),
    "nhc_lever_arm": Scale(_XYZ, 0.3, 2.5),
    "accel_scale": Scale(_XYZ, 3e-3, 3e-2),
    "gyro_scale": Scale(_XYZ, 3e-3, 3e-2),
    "gnss_noise_scale": Scale(("factor",), 1.6, 6.0, positive=True),
    "gnss_outliers": Scale(("fraction",), 0.01, 0.08, positive=True),
    "accel_bias_walk": Scale(_XYZ, 2e-3, 2e-2, every=True, positive=True),
    "gyro_bias_walk": Scale(_XYZ, 5e-5, 1e-3, every=True, positive=True),
    "earth_rotation": Scale(("on",), 1.0, 1.0, positive=True),
}
"""``earth_rotation`` is always there; the case is a base model that has it switched off."""

NULLS: Mapping[str, Scale] = {
    "accel_bias": Scale(_XYZ, 1e-2, 0.15, every=True),
    "gyro_bias": Scale(_XYZ, 2e-4, 5e-3, every=True),
    "accel_scale": Scale(_XYZ, 3e-4, 3e-3, every=True),
    "gyro_scale": Scale(_XYZ, 3e-4, 3e-3, every=True),
    "accel_bias_walk": Scale(_XYZ, 5e-5, 3e-4, every=True, positive=True),
    "gyro_bias_walk": Scale(_XYZ, 1e-6, 8e-6, every=True, positive=True),
}
"""What every data sheet allows: the base model holds it, so it is no finding."""

STOCHASTIC = frozenset({"gnss_noise_scale", "gnss_outliers", "accel_bias_walk", "gyro_bias_walk"})


def draw_effect(rng: np.random.Generator, scale: Scale) -> DrawnEffect:
    """Random values of some or all parameters of one effect."""
    names = list(scale.parameters)
    if not scale.every and len(names) > 1:
        count = int(rng.integers(1, len(names) + 1))
        names = sorted(rng.choice(names, count, replace=False).tolist())
    size = float(np.exp(rng.uniform(np.log(scale.small), np.log(scale.large))))
    out: DrawnEffect = {}
    for name in names:
        value = size * float(rng.uniform(0.5, 1.0)) if len(names) > 1 else size
        out[name] = value if scale.positive or rng.random() < 0.5 else -value
    return out


def draw_sheet(rng: np.random.Generator) -> dict[str, DrawnEffect]:
    """The errors of data-sheet size that every drive has."""
    draw: Callable[[Scale], DrawnEffect] = lambda scale: draw_effect(rng, scale)  # noqa: E731
    return {name: draw(scale) for name, scale in NULLS.items()}
