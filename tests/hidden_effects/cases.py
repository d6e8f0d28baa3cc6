"""The list of hidden cases: what is wrong, how large, on which drives, and what it should show."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from tests.hidden_effects.camera import (
    CAMERA_SCALES,
    camera_nats,
    detections_csv,
    film,
    frames_csv,
    manifest_section,
    plant_signs,
)
from tests.hidden_effects.evidence import Scene
from tests.hidden_effects.formulas import KINDS, Formula, draw_formula
from tests.hidden_effects.gnss import record_gnss
from tests.hidden_effects.imu import record_imu
from tests.hidden_effects.setting import (
    Setting,
    draw_again,
    draw_scene,
    draw_setting,
    information,
    without,
)
from tests.hidden_effects.sizes import SCALES, STOCHASTIC, DrawnEffect, draw_effect
from tests.hidden_effects.write import write_drive

BASE = ("accel_bias", "gyro_bias", "accel_scale", "gyro_scale", "gnss_correlated_noise")
"""What the model under test holds from the start; a hidden scale factor is taken out of it."""
ENOUGH_NATS = 60.0
FORMULA_NATS = (150.0, 2000.0)
PIXEL_SD = 1.0
TRIES = 12


@dataclass(frozen=True)
class Case:
    """One hidden case.

    ``kind`` null, effect, removed, triple, formula or camera; ``effects`` what is wrong, with
    values; ``evidence`` nats expected for each of them beside the others; ``left_out`` effects
    that the library under test must do without; ``switches`` settings of the base model.
    """

    id: str
    kind: str
    level: str
    seconds: float
    effects: dict[str, DrawnEffect]
    evidence: dict[str, float]
    base: tuple[str, ...] = BASE
    switches: dict[str, object] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()
    formula: str = ""
    formula_kind: str = ""

    def as_json(self) -> str:
        """One line."""
        return json.dumps(asdict(self))


def case_ids(kind: str, count: int) -> list[str]:
    """Names of the first ``count`` cases of a kind; effects and formulas take turns."""
    if kind == "effect":
        names = list(SCALES)
        return [f"effect-{names[i % len(names)]}-{i // len(names)}" for i in range(count)]
    if kind == "removed":
        names = [name for name in SCALES if name not in ("accel_scale", "gyro_scale")]
        return [f"removed-{names[i % len(names)]}-{i // len(names)}" for i in range(count)]
    if kind == "formula":
        return [f"formula-{KINDS[i % len(KINDS)]}-{i // len(KINDS)}" for i in range(count)]
    if kind == "camera":
        names = [*CAMERA_SCALES, "null"]
        return [f"camera-{names[i % len(names)]}-{i // len(names)}" for i in range(count)]
    return [f"{kind}-{i}" for i in range(count)]


@dataclass(frozen=True)
class Drawn:
    """A case with its drives still in memory.

    ``scene`` and ``held_out`` are the ideal motions; ``again`` the setting of the held-out day;
    ``size`` the coefficient of ``formula``; ``seed`` that of the noise.
    """

    case: Case
    setting: Setting
    again: Setting
    scene: Scene
    held_out: Scene
    formula: Formula | None
    size: float
    gps0: int
    seed: tuple[int, ...]


def draw_case(case_id: str) -> Drawn:
    """Everything about a case; the same ``case_id`` always gives the same."""
    kind, *name = case_id.split("-")[:-1]
    number = int(case_id.rsplit("-", 1)[1])
    seed = zlib.crc32(case_id.encode())
    hidden = _HIDDEN[kind]
    for attempt in range(TRIES):
        rng = np.random.default_rng([seed, attempt])
        setting = draw_setting(rng, kind, number)
        effects, formula, wanted = hidden(rng, setting, name[0] if name else "", number)
        setting = without(setting, effects)
        scene = draw_scene(rng, setting, effects)
        size, evidence = _evidence(rng, scene, setting, effects, formula)
        effects, evidence = _raised(rng, effects, evidence, wanted)
        if min(evidence.values(), default=np.inf) >= wanted:
            break
    again = draw_again(rng, setting)
    case = Case(
        id=case_id,
        kind=kind,
        level=setting.level,
        seconds=setting.seconds,
        effects=effects,
        evidence=evidence,
        base=tuple(name for name in BASE if name not in effects),
        switches={"earth_rotation": False} if "earth_rotation" in effects else {},
        left_out=tuple(effects) if kind == "removed" else (),
        formula="" if formula is None else f"{formula.text}, k = {size:.4g}",
        formula_kind="" if formula is None else formula.kind,
    )
    return Drawn(
        case=case,
        setting=setting,
        again=again,
        scene=scene,
        held_out=draw_scene(rng, again, effects),
        formula=formula,
        size=size,
        gps0=int(rng.integers(1_250_000_000, 1_430_000_000)),
        seed=(seed, TRIES),
    )


def write_case(drawn: Drawn, folder: Path) -> tuple[Path, Path, Path]:
    """Write ``drive``, ``holdout``, ``base.toml`` and ``case.json`` under ``folder``; returns the
    first three paths."""
    rng = np.random.default_rng(drawn.seed)
    train, held_out = folder / "drive", folder / "holdout"
    _write(train, drawn.gps0, rng, drawn, drawn.scene, drawn.setting)
    _write(held_out, drawn.gps0 + 86_400, rng, drawn, drawn.held_out, drawn.again)
    config = folder / "base.toml"
    config.write_text(base_settings(drawn.case), encoding="utf-8")
    (folder / "case.json").write_text(drawn.case.as_json() + "\n", encoding="utf-8")
    return train, held_out, config


Hidden = tuple[dict[str, DrawnEffect], Formula | None, float]


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
    ]
    while True:
        names = rng.choice(pool, 3, replace=False).tolist()
        if all(sum(effect in group for effect in names) < 2 for group in ALIKE_GROUPS):
            return {n: draw_effect(rng, SCALES[n]) for n in names}, None, ENOUGH_NATS


def _formula(rng: np.random.Generator, setting: Setting, name: str, number: int) -> Hidden:
    return {}, draw_formula(name, rng, setting.seconds), 0.0


def _camera(rng: np.random.Generator, setting: Setting, name: str, number: int) -> Hidden:
    if name == "null":
        return {}, None, 0.0
    return {name: draw_effect(rng, CAMERA_SCALES[name])}, None, ENOUGH_NATS


_HIDDEN = {
    "null": _no_effect,
    "effect": _one_effect,
    "removed": _removed,
    "triple": _three_effects,
    "formula": _formula,
    "camera": _camera,
}


def _evidence(
    rng: np.random.Generator,
    scene: Scene,
    setting: Setting,
    effects: Mapping[str, DrawnEffect],
    formula: Formula | None,
) -> tuple[float, dict[str, float]]:
    """Size of the formula, and the nats that each effect carries beside the others."""
    if formula is not None:
        unit = 0.5 * information(scene, setting, [{}], (), formula, formula.unit)[0, 0]
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
        # each with the sizes of the others unknown
        info = information(scene, setting, cases, measured)
        each = 0.5 / np.diag(np.linalg.pinv(info))
        out |= {name: float(n) for name, n in zip(measured, each, strict=True)}
    return 0.0, out


IN_THE_CAR = ("vehicle_sideslip", "nhc_lever_arm")
"""These shape the motion itself."""


def _raised(
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


def _write(
    folder: Path, gps0: int, rng: np.random.Generator, drawn: Drawn, scene: Scene, setting: Setting
) -> None:
    wrong = {**setting.sheet, **drawn.case.effects}
    formula, motion = drawn.formula, scene.motion
    imu_extra = None if formula is None else formula.imu_errors(drawn.size)
    fix_extra = None if formula is None else formula.fix_errors(drawn.size)
    imu = record_imu(motion, wrong, setting.imu, rng, setting.warm_up, imu_extra)
    gnss = record_gnss(motion, wrong, setting.gnss, rng, setting.lever_arm, fix_extra, scene.tag)
    true = motion.at(imu.stamp[::10])
    if drawn.case.kind != "camera":
        write_drive(folder, gps0, imu, gnss, setting.lever_arm, true)
        return
    write_drive(folder, gps0, imu, gnss, setting.lever_arm, true, manifest_section())
    boxes = film(motion, drawn.case.effects, rng, PIXEL_SD, plant_signs(motion, rng))
    video = folder / "video"
    video.mkdir(exist_ok=True)
    (video / "front_detections.csv").write_text(detections_csv(boxes), encoding="utf-8")
    (video / "front_frames.csv").write_text(frames_csv(boxes, gps0), encoding="utf-8")


def base_settings(case: Case) -> str:
    """The base model as a file for ``--config``."""
    names = ", ".join(f'"{name}"' for name in case.base)
    lines = ["[fuse]", f"effects = [{names}]"]
    lines += [f"{key} = {json.dumps(value)}" for key, value in case.switches.items()]
    return "\n".join(lines) + "\n"
