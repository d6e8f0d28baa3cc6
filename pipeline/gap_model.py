"""The new model as a configuration file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from automap.gap import GapDrive, GapResult


def model_toml(result: GapResult, drives: Sequence[GapDrive]) -> str:
    """Settings for ``automap run --config``: nuisances, values of the named effects, noise.

    A lever arm stands there as a whole, what the manifest says plus what was found.
    """
    model = result.model
    effects = list(model.options.effects)
    if any(d.delay.sd > 0.0 for d in drives) and "imu_time_offset" not in model.values:
        effects += [e for e in ("imu_time_offset",) if e not in effects]
    if any(d.mounting_sd.any() or not d.imu.axes_known for d in drives):
        effects += [e for e in ("imu_mounting",) if e not in effects]
    lines = [
        f"# {result.verdict}",
        "# Made by automap gap; for automap run --config, and for automap gap --config.",
        "[fuse]",
        "effects = [" + ", ".join(f'"{e}"' for e in effects) + "]",
        "adapt = false",
    ]
    options, asked = model.options, result.base.options
    if not options.earth_rotation or not asked.earth_rotation:
        lines.append(f"earth_rotation = {str(options.earth_rotation).lower()}")
    lines += ["", "[fuse.factors]"]
    lines += [f"{name} = {value:.6g}" for name, value in model.factors.items()]
    for effect, values in model.values.items():
        if not values:
            continue
        total = dict(values)
        if effect == "gnss_lever_arm" and drives[0].lever_arm is not None:
            stated = dict(zip("xyz", drives[0].lever_arm, strict=True))
            total = {p: v + float(stated[p]) for p, v in values.items()}
        lines += ["", f"[fuse.fixed.{effect}]"]
        lines += [f"{p} = {v:.9g}" for p, v in total.items()]
    return "\n".join(lines) + "\n"
