"""The list of hidden cases: what is wrong, how large, on which drives, and what it should show."""

from __future__ import annotations

import json
import zlib
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from tests.hidden_effects.camera import (
    CAMERA_SCALES,
    detections_csv,
    film,
    frames_csv,
    manifest_section,
    plant_signs,
)
from tests.hidden_effects.evidence import Scene, make_scene
from tests.hidden_effects.extras import NOTHING, Extras
from tests.hidden_effects.formulas import KINDS, Formula
from tests.hidden_effects.gnss import record_gnss
from tests.hidden_effects.hide import HIDDEN, PIXEL_SD, RECEIVERS_OWN, evidence_of, raised
from tests.hidden_effects.imu import record_imu
from tests.hidden_effects.outside import Outside, all_makers
from tests.hidden_effects.setting import (
    Setting,
    draw_again,
    draw_scene,
    draw_setting,
    without,
)
from tests.hidden_effects.sizes import SCALES, DrawnEffect
from tests.hidden_effects.write import write_drive

BASE = ("accel_bias", "gyro_bias", "accel_scale", "gyro_scale", "gnss_correlated_noise")
"""What the model under test holds from the start; a hidden scale factor is taken out of it."""
TRIES = 12


@dataclass(frozen=True)
class Case:
    """One hidden case.

    ``kind`` null, effect, removed, triple, formula, outside or camera; ``effects`` what is wrong,
    with values; ``evidence`` nats expected for each of them beside the others; ``left_out``
    effects that the library under test must do without; ``switches`` settings of the base model;
    ``receiver`` the recording whose errors the fixes have; ``truth`` in words what is outside the
    library.
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
    receiver: str = ""
    truth: str = ""

    def as_json(self) -> str:
        """One line."""
        return json.dumps(asdict(self))


REAL = "-real"
"""Ends the names of cases whose fixes have the errors of a real receiver."""
HALF_REAL = ("effect", "null", "triple")


def case_ids(kind: str, count: int) -> list[str]:
    """Names of the first ``count`` cases of a kind; effects and formulas take turns, and every
    second one of HALF_REAL has a real receiver's errors."""
    if kind in HALF_REAL:
        drawn = _ids(kind, count - count // 2, list(SCALES))
        own = [name for name in SCALES if name not in RECEIVERS_OWN]
        real = [case_id + REAL for case_id in _ids(kind, count // 2, own)]
        out = [i for pair in zip(drawn, real, strict=False) for i in pair]
        return out + drawn[len(real) :]
    return _ids(kind, count, list(SCALES))


def _ids(kind: str, count: int, names: list[str]) -> list[str]:
    turns = {
        "effect": names,
        "removed": [name for name in names if name not in ("accel_scale", "gyro_scale")],
        "formula": list(KINDS),
        "outside": list(all_makers()),
        "camera": [*CAMERA_SCALES, "null"],
    }
    if kind not in turns:
        return [f"{kind}-{i}" for i in range(count)]
    taken = turns[kind]
    return [f"{kind}-{taken[i % len(taken)]}-{i // len(taken)}" for i in range(count)]


@dataclass(frozen=True)
class Drawn:
    """A case with its drives still in memory.

    ``scene`` and ``held_out`` are the ideal motions; ``again`` the setting of the held-out day;
    ``size`` that of ``formula``, an Outside where it is no formula; ``seed`` that of the noise.
    """

    case: Case
    setting: Setting
    again: Setting
    scene: Scene
    held_out: Scene
    formula: Formula | Outside | None
    size: float
    gps0: int
    seed: tuple[int, ...]

    def extras(self) -> Extras:
        """What no library holds, at its size."""
        return NOTHING if self.formula is None else self.formula.extras(self.size)


def draw_case(case_id: str) -> Drawn:
    """Everything about a case; the same ``case_id`` always gives the same."""
    real = case_id.endswith(REAL)
    kind, *name = case_id.removesuffix(REAL).split("-")[:-1]
    number = int(case_id.removesuffix(REAL).rsplit("-", 1)[1])
    seed = zlib.crc32(case_id.encode())
    hidden = HIDDEN[kind]
    # kinds that come once each take turns with the levels of noise too
    turn = list(all_makers()).index(name[0]) if kind == "outside" else 0
    for attempt in range(TRIES):
        rng = np.random.default_rng([seed, attempt])
        setting = draw_setting(rng, kind, number + turn, real)
        effects, formula, wanted = hidden(rng, setting, name[0] if name else "", number)
        setting = without(setting, effects)
        scene = draw_scene(rng, setting, effects)
        size, evidence = evidence_of(rng, scene, setting, effects, formula)
        effects, evidence = raised(rng, effects, evidence, wanted)
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
        formula=f"{formula.text}, k = {size:.4g}" if isinstance(formula, Formula) else "",
        formula_kind="" if formula is None else formula.kind,
        receiver="" if setting.replay is None else setting.replay.recording,
        truth=formula.told(size) if isinstance(formula, Outside) else "",
    )
    held_out = draw_scene(rng, again, effects)
    body = None if formula is None else formula.extras(size).body
    if body is not None:
        scene, held_out = (
            make_scene(s.motion.bent(body), s.tag, s.lever_arm) for s in (scene, held_out)
        )
    return Drawn(
        case=case,
        setting=setting,
        again=again,
        scene=scene,
        held_out=held_out,
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


def _write(
    folder: Path, gps0: int, rng: np.random.Generator, drawn: Drawn, scene: Scene, setting: Setting
) -> None:
    wrong = {**setting.sheet, **drawn.case.effects}
    extras, motion = drawn.extras(), scene.motion
    imu = record_imu(
        motion,
        wrong,
        setting.imu,
        rng,
        setting.warm_up,
        extras.imu,
        readings=extras.readings,
        clock=extras.clock,
    )
    arm = setting.lever_arm
    gnss = record_gnss(motion, wrong, setting.gnss, rng, arm, extras.fix, scene.tag, setting.replay)
    true = motion.at(imu.stamp[::10])
    if drawn.case.kind != "camera" and extras.flex is None:
        write_drive(folder, gps0, imu, gnss, setting.lever_arm, true)
        return
    write_drive(folder, gps0, imu, gnss, setting.lever_arm, true, manifest_section())
    boxes = film(motion, drawn.case.effects, rng, PIXEL_SD, plant_signs(motion, rng), extras.flex)
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
