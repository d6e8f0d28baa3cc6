"""The new model as a configuration file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from automap.effects.user import user_effects
from automap.effects.user_tables import as_table
from automap.gap.candidates import twins_of
from automap.gap.fit import BASE_NUISANCES
from automap.io.toml_file import toml_value

if TYPE_CHECKING:
    from automap.gap import GapDrive, GapModel, GapResult
from automap.fusion.options import FusionOptions
from pipeline.settings.effects import EffectsSettings

_NINE = "{:.9g}".format
"""Nine digits are more than any estimate has."""


def model_toml(
    result: GapResult,
    drives: Sequence[GapDrive],
    users: EffectsSettings,
    folder: Path,
    cameras: Sequence[str] = (),
) -> str:
    """Settings for ``automap run --config``: nuisances, values of the named effects, and the levels
    of noise that a run begins with: its own it finds as without them, for how closely a path should
    follow the fixes of another day no day before tells.

    A lever arm stands there as a whole, what the manifest says plus what was found. The users'
    effects and a formula that was found are defined there too; the file is written to ``folder``.
    ``cameras`` are the lines about the cameras.
    """
    model, left = result.model, left_to_runs(result)
    effects = list(model.options.effects)
    if any(d.delay.sd > 0.0 for d in drives) and "imu_time_offset" not in model.values:
        effects += [e for e in ("imu_time_offset",) if e not in effects]
    if any(d.mounting_sd.any() or not d.imu.axes_known for d in drives):
        effects += [e for e in ("imu_mounting",) if e not in effects]
    lines = [
        f"# {result.verdict}",
        "# Made by automap gap; for automap run --config, and for automap gap --config.",
        *(f"# {name} is left out: a run estimates {', '.join(n)} anew" for name, n in left.items()),
        *_definitions(result, users, folder),
        "[fuse]",
        *_nuisances(model, effects),
    ]
    options, asked = model.options, result.base.options
    if not options.earth_rotation or not asked.earth_rotation:
        lines.append(f"earth_rotation = {str(options.earth_rotation).lower()}")
    if options.shocks:
        lines.append("shocks = true")
    lines.append(f"velocity_wander_sd = {options.velocity_wander_sd:.6g}")
    if options.velocity_wander_sd > 0.0:
        lines.append(f"velocity_wander_tau_s = {options.velocity_wander_tau_s:.6g}")
    lines += ["", "# where a run begins to look for its own", "[fuse.factors]"]
    lines += [f"{name} = {value:.6g}" for name, value in model.factors.items()]
    for effect, values in model.values.items():
        if not values or effect in left:
            continue
        total = dict(values)
        if effect == "gnss_lever_arm" and drives[0].lever_arm is not None:
            stated = dict(zip("xyz", drives[0].lever_arm, strict=True))
            total = {p: v + float(stated[p]) for p, v in values.items()}
        lines += ["", f"[fuse.fixed.{effect}]"]
        lines += [f"{p} = {v:.9g}" for p, v in total.items()]
    return "\n".join([*lines, *cameras]) + "\n"


def left_to_runs(result: GapResult) -> dict[str, tuple[str, ...]]:
    """Findings that the written model is without, and effects that cannot be told from each which
    a run with it estimates on every drive anyhow: these say there what the finding says here, and
    one that was taken for known would stay wrong if it is another. What is one of them to first
    order does the same whatever its name."""
    model = result.model
    effects = model.options.effects if _nuisances(model, ()) else FusionOptions().effects
    estimated = set(effects) - set(model.values)
    out = {}
    for finding in result.findings:
        twins = twins_of((finding.effect,))
        instead = [n for n in finding.confusable_with if n in estimated and n not in twins]
        if instead and finding.effect not in effects:
            out[finding.effect] = tuple(instead)
    return out


def _nuisances(model: GapModel, effects: Sequence[str]) -> list[str]:
    """The line of estimated effects, where somebody stated them. An ordinary run estimates more
    than the base model of a search, scale factors for one, and errs less with them; delays that
    are every drive's own are among these."""
    base, run = set(BASE_NUISANCES), set(FusionOptions().effects)
    if base <= set(model.options.effects) <= base | run:
        return []
    return ["effects = [" + ", ".join(f'"{e}"' for e in effects) + "]"]


def _definitions(result: GapResult, users: EffectsSettings, folder: Path) -> list[str]:
    """The section ``[effects]``: what the configuration had, and the formula that was found."""
    tables: dict[str, dict[str, Any]] = {k: dict(v) for k, v in users.formulas.items()}
    for effect in user_effects():
        table = as_table(effect)
        if table is not None and effect.name in result.model.values:
            tables.setdefault(effect.name, table)
    lines: list[str] = []
    if users.files:
        names = [Path(os.path.relpath(p, folder.resolve())).as_posix() for p in users.files]
        lines += ["[effects]", f"files = {toml_value(names)}", ""]
    for name, table in tables.items():
        lines.append(f"[effects.formulas.{name}]")
        for key, value in table.items():
            if isinstance(value, dict):
                inner = ", ".join(f"{k} = {toml_value(v, _NINE)}" for k, v in value.items())
                lines.append(f"{key} = {{ {inner} }}")
            else:
                lines.append(f"{key} = {toml_value(value, _NINE)}")
        lines.append("")
    return lines
