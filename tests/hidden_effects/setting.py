"""What the drives of a case have in common, and the roads they are driven on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tests.hidden_effects.evidence import Scene, make_scene, shifts_of, whiten
from tests.hidden_effects.extras import NOTHING, Extras
from tests.hidden_effects.geodesy import Array
from tests.hidden_effects.gnss import draw_tags
from tests.hidden_effects.motion import Motion
from tests.hidden_effects.noise import GnssNoise, ImuNoise, draw_noise
from tests.hidden_effects.real_receiver import Replay, draw_replay
from tests.hidden_effects.route import draw_plan, draw_style
from tests.hidden_effects.sizes import NULLS, DrawnEffect, draw_effect, draw_sheet

LEVEL_ORDER = ("usual", "quiet", "dirty", "usual", "poor")


@dataclass(frozen=True)
class Setting:
    """What all drives of a case share: car, sensors, place, level of noise."""

    seconds: float
    level: str
    imu: ImuNoise
    gnss: GnssNoise
    lever_arm: Array
    warm_up: tuple[float, float, float]
    sheet: dict[str, DrawnEffect]
    replay: Replay | None = None


def draw_setting(rng: np.random.Generator, kind: str, number: int, real: bool = False) -> Setting:
    """Sensors and car of a case; nulls last two minutes, the others up to ten, those with the
    errors of a ``real`` receiver, which tells little in two, four at least."""
    level = LEVEL_ORDER[number % len(LEVEL_ORDER)]
    imu, gnss = draw_noise(rng, level)
    shortest = 240.0 if real else 150.0
    if kind == "null":
        seconds = 240.0 if real else 120.0
    else:
        seconds = float(np.round(np.exp(rng.uniform(*np.log([shortest, 600.0])))))
    arm = np.round(rng.uniform([-1.5, -0.6, -1.6], [1.5, 0.6, -0.3]), 3)
    warm_up = (
        float(rng.uniform(5.0, 30.0)),
        float(rng.uniform(8.0, 25.0)),
        float(rng.uniform(0.15, 0.7) * seconds),
    )
    setting = Setting(seconds, level, imu, gnss, arm, warm_up, draw_sheet(rng))
    if not real:
        return setting
    replay = draw_replay(rng, seconds)
    return replace(setting, replay=replay, gnss=replay.series().noise())


def without(setting: Setting, effects: Mapping[str, DrawnEffect]) -> Setting:
    """The setting without the data sheet's share of what is hidden."""
    sheet = {name: value for name, value in setting.sheet.items() if name not in effects}
    return replace(setting, sheet=sheet)


def draw_again(rng: np.random.Generator, setting: Setting) -> Setting:
    """The same car on another day: new turn-on biases, another warm-up, a shorter drive."""
    sheet = setting.sheet | {
        name: draw_effect(rng, NULLS[name]) for name in ("accel_bias", "gyro_bias")
    }
    start, rise, constant = setting.warm_up
    seconds = float(np.round(rng.uniform(120.0, 200.0)))
    replay = setting.replay
    return replace(
        setting,
        sheet=sheet,
        seconds=seconds,
        replay=None if replay is None else draw_replay(rng, seconds, replay.recording),
        warm_up=(start + float(rng.uniform(-5.0, 5.0)), rise, constant),
    )


def draw_scene(
    rng: np.random.Generator, setting: Setting, effects: Mapping[str, DrawnEffect]
) -> Scene:
    """A drive somewhere on Earth, with what is hidden in the car itself."""
    style = draw_style(rng, rough=setting.level == "dirty")
    slip = sum(effects.get("vehicle_sideslip", {}).values())
    if slip:
        # on a level road the slip per lateral acceleration is the slip per lateral force
        style = replace(style, bank=1e-4, roll_gradient=0.0)
    axle = effects.get("nhc_lever_arm")
    place = (
        float(np.radians(rng.uniform(-60.0, 65.0))),
        float(np.radians(rng.uniform(-170.0, 170.0))),
        float(rng.uniform(0.0, 900.0)),
    )
    motion = Motion(
        draw_plan(rng, style, setting.seconds),
        place,
        setting.seconds,
        rng,
        axle=None if axle is None else np.array([axle.get(a, 0.0) for a in "xyz"]),
        sideslip=slip,
    )
    replay = setting.replay
    if replay is None:
        tag = draw_tags(setting.seconds, setting.gnss, rng)
    else:
        tag = replay.tags(setting.seconds)
    return make_scene(motion, tag, setting.lever_arm)


def walks(setting: Setting) -> tuple[Array, Array]:
    """Densities [3] of the accelerometer's and the gyro's in-run drift."""
    accel, gyro = (
        np.array([setting.sheet.get(name, {}).get(axis, 0.0) for axis in "xyz"])
        for name in ("accel_bias_walk", "gyro_bias_walk")
    )
    return accel, gyro


def information(
    scene: Scene,
    setting: Setting,
    cases: Sequence[Mapping[str, DrawnEffect]],
    hidden: Sequence[str],
    extras: Extras = NOTHING,
) -> Array:
    """Twice the nats [k, k] between errors, beyond what the base model absorbs.

    ``hidden`` effects are not in the base model, where it would have them otherwise.
    """
    shifts = shifts_of(scene, list(cases), setting.warm_up, extras)
    drift = walks(setting)
    return whiten(scene, shifts, setting.imu, setting.gnss, *drift, without=hidden).gram()
