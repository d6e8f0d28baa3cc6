"""What is left unexplained, in words: in which channel, when, how large."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from automap.fusion.layout import CHANNELS
from automap.gap.misfit import AFTER
from pipeline.gap.effect_words import in_a_word, listed, sentence_case
from pipeline.gap.sizes import about

if TYPE_CHECKING:
    from automap.gap.fit import Fit
    from automap.gap.misfit import Misfit

SHOWN = 3
LEAST = 1e-4
WAYS = {"n": "north", "e": "east", "d": "down"}
ALONG = {"along": "along the way", "across": "across the way"}


def misfit_words(misfits: Sequence[Misfit], after: Sequence[Fit] = ()) -> tuple[str, str]:
    """All misfits, the largest first, summed up by channel; ``after`` the held-out fits of the new
    model, which tell what the channel should scatter by."""
    by_channel: dict[str, list[Misfit]] = {}
    for one in misfits:
        by_channel.setdefault(one.channel, []).append(one)
    parts = [_channel(name, ones, after) for name, ones in list(by_channel.items())[:SHOWN]]
    rest = list(by_channel)[SHOWN:]
    if rest:
        parts.append(f"Less so: {listed([channel_name(c) for c in rest])}.")
    worst = max((math.sqrt(m.size) for m in misfits if not m.suspected), default=1.0)
    bars = f"take the error bars of the path for up to {worst:.1f} times too small there. "
    parts.append(
        f"What to do: {bars if worst > 1.0 else ''}"
        "Every place stands in the table under Not explained; look there at what receiver and road "
        "did then. Another drive along the same places shows whether it comes back."
    )
    return "Something is left that no candidate explains.", " ".join(parts)


def channel_name(channel: str) -> str:
    """A channel of the receiver as a person calls it."""
    what, _, way = channel.rpartition("_")
    if way in WAYS:
        return f"the {WAYS[way]} {what}"
    return f"the {what} {ALONG[way]}" if way in ALONG else f"the {channel.replace('_', ' ')}"


def _channel(name: str, ones: Sequence[Misfit], after: Sequence[Fit]) -> str:
    sized = [m for m in ones if not m.suspected]
    follows = " ".join(_follows(m) for m in ones if m.suspected)
    if not sized:
        return follows
    worst = max(sized, key=lambda m: m.size)
    factor = math.sqrt(worst.size)
    text = (
        f"{sentence_case(channel_name(name))} scatters {factor:.1f} times as much as the model says"
    )
    usual = _expected(name, after)
    if usual is not None:
        unit = "m/s" if name.startswith("velocity") else "m"
        text += f" ({about(factor * usual, unit, LEAST)} in place of {about(usual, unit, LEAST)})"
    text += f", {_where(worst)}"
    # when: the worst stretch of the drive, where that is not the worst of all
    times = [m for m in ones if m.kind == "time"]
    if times and worst.kind != "time":
        when = max(times, key=lambda m: m.size)
        text += f"; of all times most {_where(when)} ({math.sqrt(when.size):.1f} times)"
    elif not times:
        text += "; at no time more than at others"
    return f"{text}. {follows}".rstrip()


def _follows(one: Misfit) -> str:
    """What a channel follows, more than chance lets it, though no name is sure."""
    channel = sentence_case(channel_name(one.channel))
    what, after, manoeuvre = one.where.partition(f" {AFTER} ")
    if one.kind == AFTER and after:
        return (
            f"{channel} shows that {channel_name(what)} is off after {manoeuvre}, at once or up to "
            "a minute later, more than chance lets it."
        )
    return (
        f"{channel} follows what {in_a_word(one.where)} would do more than chance lets it, though "
        "not so surely that this is its name."
    )


def _where(one: Misfit) -> str:
    words = {"band": "at", "time": "from", "speed": "at", "turn": "at", "acceleration": "at"}
    return f"{words.get(one.kind, 'at')} {one.where}"


def _expected(channel: str, fits: Sequence[Fit]) -> float | None:
    """The usual sd of a channel's innovations under a model."""
    if channel not in CHANNELS:
        return None
    code = CHANNELS.index(channel)
    stores = [fit.last.forward.store for fit in fits]
    var = [store.var[store.info[:, 1] == code] for store in stores]
    every = np.concatenate(var) if var else np.zeros(0)
    return float(np.sqrt(np.median(every))) if len(every) else None
