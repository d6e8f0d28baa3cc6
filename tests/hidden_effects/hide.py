"""What is hidden in a case of each kind, how large, and how many nats it carries."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tests.hidden_effects.camera import CAMERA_SCALES, camera_nats, film, plant_signs
from tests.hidden_effects.evidence import Scene
from tests.hidden_effects.extras import Extras
from tests.hidden_effects.formulas import Formula, draw_formula
from tests.hidden_effects.outside import Outside, all_makers
from tests.hidden_effects.setting import Setting, information
from tests.hidden_effects.sizes import SCALES, STOCHASTIC, DrawnEffect, draw_effect

ENOUGH_NATS = 60.0
FORMULA_NATS = (150.0, 2000.0)
OUTSIDE_NATS = (60.0, 500.0)
PIXEL_SD = 1.0
RECEIVERS_OWN = (
    "gnss_latency",
    "imu_time_offset",
    "gnss_velocity_latency",
    "gnss_velocity_lag",
    "gnss_noise_scale",
    "gnss_outliers",
)
"""A real receiver has these of its own, nobody knows how large: none is hidden on top. A delay of
the IMU's is one of all fixes: that of a phone's positions by -0.12 s undid one of -0.14 s."""

Hidden = tuple[dict[str, DrawnEffect], Formula | Outside | None, float]


def _no_effect(rng: np.random.Generator, setting: Setting, name: str, number: int) -> Hidden:
    # a datum that lies elsewhere shows in no drive of its own: as null as no error at all
    datum = {axis: float(rng.normal(0.0, 1.0)) for axis in "ned"}
    return ({"gnss_datum_shift": datum} if number % 4 == 3 else {}), None, 0.0


def _one_effect(rng: np.random.Generator, setting: Setting, name: str, number: int) -> Hidden:
    # the last of five seeds is as small as it comes
    wanted = 0.0 if number % 5 == 4 else ENOUGH_NATS
    return {name: draw_effect(rng, SCALES[name])}, None, wanted


def _removed(rng: np.random.Generator, setting: Setting, name: str, number: int) -> Hidden:
    return {name: draw_effect(rng, SCALES[name])}, None, ENOUGH_NATS


ALIKE_GROUPS = (
    ("imu_time_offset", "gnss_latency"),
    ("gnss_velocity_latency", "gnss_velocity_lag"),
)
"""Together these are one error seen from two sides, so a triple has one of them at most."""


def _three_effects(rng: np.random.Generator, setting: Setting, name: str, number: int) -> Hidden:
    pool = [
        effect
        for effect in SCALES
        if effect not in STOCHASTIC
        and effect not in ("accel_scale", "gyro_scale", "earth_rotation")
        and not (setting.replay is not None and effect in RECEIVERS_OWN)
    ]
    while True:
        names = rng.choice(pool, 3, replace=False).tolist()
        if all(sum(effect in group for effect in names) < 2 for group in ALIKE_GROUPS):
            return {n: draw_effect(rng, SCALES[n]) for n in names}, None, ENOUGH_NATS


def _formula(rng: np.random.Generator, setting: Setting, name: str, number: int) -> Hidden:
    return {}, draw_formula(name, rng, setting.seconds), 0.0


def _outside(rng: np.random.Generator, setting: Setting, name: str, number: int) -> Hidden:
    return {}, all_makers()[name](rng, setting.seconds), ENOUGH_NATS


def _camera(rng: np.random.Generator, setting: Setting, name: str, number: int) -> Hidden:
    if name == "null":
        return {}, None, 0.0
    return {name: draw_effect(rng, CAMERA_SCALES[name])}, None, ENOUGH_NATS


HIDDEN = {
    "null": _no_effect,
    "effect": _one_effect,
    "removed": _removed,
    "triple": _three_effects,
    "formula": _formula,
    "outside": _outside,
    "camera": _camera,
}


def evidence_of(
    rng: np.random.Generator,
    scene: Scene,
    setting: Setting,
    effects: Mapping[str, DrawnEffect],
    formula: Formula | Outside | None,
) -> tuple[float, dict[str, float]]:
    """Size of the formula, and the nats that each effect carries beside the others."""
    if isinstance(formula, Outside):
        size, nats = _outside_size(rng, scene, setting, formula)
        return size, {formula.kind: nats}
    if formula is not None:
        unit = 0.5 * information(scene, setting, [{}], (), formula.extras(formula.unit))[0, 0]
        nats = float(np.exp(rng.uniform(*np.log(FORMULA_NATS))))
        size = formula.unit * float(np.sqrt(nats / unit)) * float(rng.choice([-1.0, 1.0]))
        return size, {"formula": nats}
    out = {
        name: _noise_nats(name, effects[name], setting) for name in effects if name in STOCHASTIC
    }
    if set(effects) & set(CAMERA_SCALES):
        boxes = film(scene.motion, effects, rng, PIXEL_SD, plant_signs(scene.motion, rng))
        return 0.0, dict.fromkeys(effects, camera_nats(scene.motion, effects, boxes, PIXEL_SD))
    measured = [name for name in effects if name in SCALES and name not in STOCHASTIC]
    if measured:
        cases = [{name: effects[name]} for name in measured]
        if setting.replay is not None:
            # its velocities' age must be found along
            cases += [{name: {"s": 0.1}} for name in ("gnss_velocity_latency", "gnss_velocity_lag")]
        # each with the sizes of the others unknown
        info = information(scene, setting, cases, measured)
        each = 0.5 / np.diag(np.linalg.pinv(info))[: len(measured)]
        out |= {name: float(n) for name, n in zip(measured, each, strict=True)}
    return 0.0, out


def _outside_size(
    rng: np.random.Generator, scene: Scene, setting: Setting, outside: Outside
) -> tuple[float, float]:
    """A size whose nats lie in OUTSIDE_NATS where its natural scale goes so far, and its nats."""
    wanted = float(np.exp(rng.uniform(*np.log(OUTSIDE_NATS))))
    sign = float(rng.choice([-1.0, 1.0])) if outside.signed else 1.0
    size = float(np.sqrt(outside.small * outside.large))
    nats = 0.0
    # not all grow with the square of their size, but all grow
    for _ in range(8):
        nats = _outside_nats(rng, scene, setting, outside.extras(sign * size))
        if abs(np.log(max(nats, 1e-9) / wanted)) < 0.2:
            break
        factor = float(np.clip(np.sqrt(wanted / max(nats, 1e-9)), 1.0 / 30.0, 30.0))
        again = float(np.clip(factor * size, outside.small, outside.large))
        if again == size:
            break
        size = again
    return sign * size, nats


def _outside_nats(
    rng: np.random.Generator, scene: Scene, setting: Setting, extras: Extras
) -> float:
    """Nats of what no library holds, in the fixes or, of the camera's, in the boxes."""
    if extras.flex is None:
        return 0.5 * float(information(scene, setting, [{}], (), extras)[0, 0])
    plates = plant_signs(scene.motion, rng)
    boxes = film(scene.motion, {}, rng, PIXEL_SD, plates, extras.flex)
    return camera_nats(scene.motion, {}, boxes, PIXEL_SD, extras.flex)


IN_THE_CAR = ("vehicle_sideslip", "nhc_lever_arm")
"""These shape the motion itself."""


def raised(
    rng: np.random.Generator,
    effects: dict[str, DrawnEffect],
    evidence: dict[str, float],
    wanted: float,
) -> tuple[dict[str, DrawnEffect], dict[str, float]]:
    """Effects that show too little made larger, as far as their natural scale goes; evidence
    grows with the square."""
    effects, evidence = dict(effects), dict(evidence)
    for name, nats in evidence.items():
        if name not in SCALES or name in STOCHASTIC or name in IN_THE_CAR or nats >= wanted:
            continue
        factor = float(np.sqrt(wanted / max(nats, 1e-9)) * rng.uniform(1.0, 2.0))
        if factor * max(abs(v) for v in effects[name].values()) <= SCALES[name].large:
            effects[name] = {p: factor * v for p, v in effects[name].items()}
            evidence[name] = factor**2 * nats
    return effects, evidence


def _noise_nats(name: str, values: DrawnEffect, setting: Setting) -> float:
    """Expected gain in log-likelihood of a noise that the base model does not have, roughly."""
    fixes = setting.seconds * setting.gnss.rate_hz
    if name == "gnss_noise_scale":
        a2 = values["factor"] ** 2
        return float(3.0 * fixes * (0.5 * (a2 - 1.0) - 0.5 * np.log(a2)))
    if name == "gnss_outliers":
        return float(fixes * values["fraction"] * 30.0)
    # a drift of the bias over a minute against what the filter sees of it in that time
    over_minute = np.array([values[axis] for axis in "xyz"]) * np.sqrt(60.0)
    if name == "accel_bias_walk":
        seen = setting.gnss.velocity / 60.0 + setting.imu.accel / np.sqrt(60.0)
    else:
        seen = setting.gnss.velocity / (9.8 * 60.0) + setting.imu.gyro / np.sqrt(60.0)
    ratio2 = (over_minute / seen) ** 2
    return float(setting.seconds / 60.0 * np.sum(0.5 * np.log1p(ratio2)))
