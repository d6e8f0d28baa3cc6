"""What of gap.json is about held-out positions and the path: degrees, with units in the names."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from automap.gap import GapResult
    from automap.gap.result import Cost, Extent, HeldPositions


def held_out_json(result: GapResult) -> dict[str, Any]:
    """Costs by effect or level of noise, effects that were kept out, and how well positions are
    predicted."""
    return {
        "costs": {name: _cost(cost) for name, cost in result.costs.items()},
        "kept_out": [
            {
                "effect": k.effect,
                "positions_worse": k.positions,
                "nats": k.nats,
                "each_drive": k.each_drive,
            }
            for k in result.kept_out
        ],
        "held_out_positions": _positions(result.positions),
    }


def _cost(cost: Cost) -> dict[str, float]:
    metres = {**_numbers("level", cost.level), **_numbers("height", cost.height)}
    angles = {**_numbers("heading", cost.heading), **_numbers("tilt", cost.tilt)}
    return {
        **{f"{k}_m": v for k, v in metres.items()},
        **{f"{k}_deg": math.degrees(v) for k, v in angles.items()},
    }


def _numbers(name: str, extent: Extent) -> dict[str, float]:
    return {f"{name}_rms": extent.rms, f"{name}_max": extent.largest}


def _positions(positions: HeldPositions | None) -> dict[str, float] | None:
    if positions is None:
        return None
    return {
        "level_rms_before_m": positions.level[0],
        "level_rms_after_m": positions.level[1],
        "height_rms_before_m": positions.height[0],
        "height_rms_after_m": positions.height[1],
    }
