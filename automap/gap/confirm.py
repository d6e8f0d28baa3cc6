"""What held-out data say of effects that were found: each must not be spoken against, and the model
with all of them must not predict positions worse than without."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from automap.fusion.layout import CH_POS
from automap.gap import limits
from automap.gap.drive import OpenDrive
from automap.gap.fit import Fit
from automap.gap.heldout import fit_held_out, total_score
from automap.gap.model import GapModel, Values
from automap.gap.scoring import whitener_of
from automap.records import FloatArray


@dataclass(frozen=True)
class Confirmed:
    """Effects that held-out data let stand, with their values, and a sentence on each other."""

    values: dict[str, Mapping[str, float]]
    warnings: tuple[str, ...]


def confirmed(held_out: Sequence[OpenDrive], model: GapModel, values: Values) -> Confirmed:
    """Judge effects at ``values`` on held-out drives under ``model``."""
    kept: dict[str, Mapping[str, float]] = dict(values)
    warnings = []
    if not held_out:
        return Confirmed(kept, ())
    fits = fit_held_out(held_out, model, kept)
    for effect in list(kept):
        fewer = {e: v for e, v in kept.items() if e != effect}
        without = fit_held_out(held_out, model, fewer, fits)
        whitener = whitener_of(fits[0])
        gain = total_score(fits, whitener) - total_score(without, whitener)
        if gain < -limits.HELD_OUT_SLACK:
            kept, fits = fewer, without
            warnings.append(
                f"{effect} explains the fitted data, but the held-out data are {-gain:.0f} nats "
                "less likely with it; it is not named"
            )
    # under the same noise: a filter that follows its fixes more closely predicts the next one well
    plain = position_rms(fit_held_out(held_out, model, {}, fits))
    while kept and _worse(position_rms(fits), plain):
        tries = []
        for effect in kept:
            fewer = {e: v for e, v in kept.items() if e != effect}
            without = fit_held_out(held_out, model, fewer, fits)
            tries.append((float(position_rms(without).sum()), effect, fewer, without))
        _, effect, kept, fits = min(tries, key=lambda item: item[0])
        warnings.append(
            f"with {effect} held-out positions are predicted worse than without; it is kept out "
            "of the model"
        )
    return Confirmed(kept, tuple(warnings))


def position_rms(fits: Sequence[Fit]) -> FloatArray:
    """By how much positions differ from what is predicted of them: median [2] level and down, m."""
    squares: list[list[FloatArray]] = [[], []]
    for fit in fits:
        store = fit.last.forward.store
        channel = store.info[:, 1]
        for side, axes in enumerate(((CH_POS, CH_POS + 1), (CH_POS + 2,))):
            squares[side].append(store.nu[np.isin(channel, axes)] ** 2)
    # one wild fix must not decide
    return np.array([np.sqrt(np.median(np.concatenate(s))) if len(s) else 0.0 for s in squares])


def _worse(after: FloatArray, before: FloatArray) -> bool:
    return bool((after > (1.0 + limits.WORSE_POSITIONS) * before).any())
