"""What the gap finder says."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from automap.effects import CATALOGUE
from automap.effects.user import OF_ANTENNA, OF_MOUNT

LEAST_SHOWN_P = 1e-12

# A path that is stretched, turned or held otherwise in the vehicle leaves all data as they are if
# each channel errs by what the change does to it: an error of one is the opposite one of all others
STRETCHED = "positions that are stretched by as much the other way, as by the scale of a map"
TURNED = "positions that are turned by as much the other way, as those on the grid of a map are"
MOUNT = "a unit that turns in its mount by as much"
BODY = "a vehicle, the unit with it, that turns by as much against its way"
SLIDING = "a unit that slides by as much the other way"
OF_EFFECT = {"gnss_velocity_scale": STRETCHED, "vehicle_sideslip": MOUNT}
SPEED = "speed"


def elsewhere(effect: str, terms: Sequence[tuple[str, str]] = ()) -> str:
    """What would make the same of all data as an effect of the catalogue, or as a formula of one of
    the ``terms``, channel and text; nothing where that is known of none."""
    told = [OF_EFFECT[effect]] if effect in OF_EFFECT else [_of_term(*term) for term in terms]
    return told[0] if len(set(told)) == 1 else ""


def _of_term(channel: str, text: str) -> str:
    if channel in OF_MOUNT:
        return BODY
    if channel in OF_ANTENNA:
        return SLIDING
    if channel == "velocity_across" and text == SPEED:
        return TURNED
    # the constraint is of a velocity: an angle times the speed
    slips = channel in ("nhc_y", "nhc_z") and SPEED in text.split(" * ")
    return MOUNT if slips else ""


@dataclass(frozen=True)
class ParameterValue:
    """A number of an effect with one sigma and unit; the sigma is infinite where it lies at the
    upper end of where it was sought, and is ``value`` at least."""

    value: float
    sd: float
    unit: str

    def __str__(self) -> str:
        if math.isinf(self.sd):
            return f"at least {self.value:.3g} {self.unit}".rstrip()
        return f"{self.value:.3g} ± {self.sd:.2g} {self.unit}".rstrip()


@dataclass(frozen=True)
class Drift:
    """How a parameter that is told as one number changes: by ``change`` ± ``sd`` in ``unit``.

    ``kind`` "trend" along the ``quantity`` (that of the drives' time, or what else it goes with),
    "settling" where most of it comes first, "step" ``at`` a value of it, in words ``when``, or
    "drive" on the drive of that number, from 0; nats by which the data are likelier with it, and
    whether that is ``sure``, a thousand to one.
    """

    parameter: str
    kind: str
    change: float
    sd: float
    unit: str
    quantity: str
    at: float
    when: str
    evidence_nats: float
    sure: bool = False

    def __str__(self) -> str:
        size = f"{self.change:+.2g} ± {self.sd:.1g} {self.unit}".rstrip()
        return f"something that changes: its {self.parameter} by {size} {self.when}"


@dataclass(frozen=True)
class Finding:
    """A missing effect by name.

    ``evidence_nats`` log Bayes factor against the model without it; ``p_value`` chance that the
    strongest of all candidates reaches as much where nothing is missing; gaps before and after
    it was added, nats an epoch on held-out data; ``confusable_with`` effects that this data
    cannot tell from it; ``advice`` the manoeuvre that would; ``resembles`` what speaks for
    something like it, but not for it: a formula that explains more;
    ``drift`` how it changes where it is not constant.
    """

    effect: str
    parameters: Mapping[str, ParameterValue]
    evidence_nats: float
    p_value: float
    gap_before: float
    gap_after: float
    confusable_with: tuple[str, ...] = ()
    advice: str = ""
    resembles: str = ""
    drift: Drift | None = None

    @property
    def same_as(self) -> str:
        """What makes the same of all data in another channel, nothing for most."""
        return elsewhere(self.effect)


@dataclass(frozen=True)
class Term:
    """One regressor on one channel: coefficient and sd in the unit of the channel per unit of the
    quantity."""

    channel: str
    text: str
    coefficient: float
    sd: float


def equation(terms: Sequence[tuple[str, str]]) -> str:
    """What terms of channel and text add, as a person writes it."""
    names = coefficient_names(len(terms))
    return "; ".join(f"{on} += {k} * {text}" for k, (on, text) in zip(names, terms, strict=True))


def coefficient_names(count: int) -> tuple[str, ...]:
    """k, k2, k3 and so on."""
    return ("k", *(f"k{i}" for i in range(2, count + 1)))


@dataclass(frozen=True)
class NoiseClaim:
    """A level of noise that is not as stated: ``factor`` on what data sheet or preset says, with
    the nats by which the drives are likelier with it; where it is so under a ``condition`` alone,
    in words, the factor ``elsewhere``; ``cause`` what the readings themselves show of why."""

    level: str
    factor: float
    evidence_nats: float
    p_value: float
    condition: str = ""
    elsewhere: float = 0.0
    cause: str = ""

    def __str__(self) -> str:
        """What is claimed, as a person writes it."""
        text = f"{self.level.replace('_', ' ')} {self.factor:.2g} times"
        if self.condition:
            text += f" {self.condition} and {self.elsewhere:.2g} times elsewhere"
        because = f": {self.cause}" if self.cause else ""
        return f"{text} ({self.evidence_nats:.0f} nats){because}"


@dataclass(frozen=True)
class Refused:
    """The strongest candidate that is not named: its name, evidence in nats, and the chance that
    the strongest of all reaches so much where nothing is missing; the ``channel`` in which it shows
    most, and the variance there, times modelled, where it would act."""

    effect: str
    evidence_nats: float
    p_value: float
    channel: int = 0
    size: float = 1.0


@dataclass(frozen=True)
class Unexplained:
    """Something that no effect of the library explains: channel, formula, coefficient with sd;
    ``terms`` all of a formula that acts in several places, that of ``channel`` first;
    ``confusable_with`` other forms, or names, that these drives do not tell from it.

    ``effect`` its name in the new model, None where the model does without it (an effect of the
    catalogue that was to be left out); gaps before and after it on held-out data.
    """

    channel: str
    formula: str
    coefficient: float
    sd: float
    evidence_nats: float
    p_value: float
    resembles: str | None = None
    effect: str | None = None
    gap_before: float | None = None
    gap_after: float | None = None
    terms: tuple[Term, ...] = ()
    confusable_with: tuple[str, ...] = ()

    @property
    def same_as(self) -> str:
        """What makes the same of all data in another channel, nothing for most."""
        return elsewhere("", [(term.channel, term.text) for term in self.terms])

    @property
    def numbers(self) -> str:
        """The coefficients in words."""
        if len(self.terms) < 2:
            return f"k = {self.coefficient:.3g} ± {self.sd:.2g}"
        names = coefficient_names(len(self.terms))
        return ", ".join(
            f"{name} = {term.coefficient:.3g} ± {term.sd:.2g}"
            for name, term in zip(names, self.terms, strict=True)
        )


@dataclass(frozen=True)
class Extent:
    """How far something is off along a drive: root mean square, and the largest size."""

    rms: float
    largest: float


@dataclass(frozen=True)
class Cost:
    """How far the smoothed held-out path is off where one effect is left out of the new model:
    ``level`` and ``height`` in m, ``heading`` and ``tilt`` (of the vehicle's down axis) in rad, all
    at the same IMU stamps."""

    level: Extent
    height: Extent
    heading: Extent
    tilt: Extent


@dataclass(frozen=True)
class KeptOut:
    """An effect that the fitted data speak for, but not the held-out ones; its value is not in the
    model.

    ``positions``: with it held-out positions are predicted worse. Otherwise they are less likely by
    ``nats``. ``each_drive``: a receiver's delay, which every drive is fitted with anew instead.
    """

    effect: str
    positions: bool
    nats: float = 0.0
    each_drive: bool = False


@dataclass(frozen=True)
class HeldPositions:
    """Root mean square in m by which held-out positions differ from their prediction, (without,
    with) what was found, under the same noise, ``level`` and in ``height``; wild ones count as
    little else."""

    level: tuple[float, float]
    height: tuple[float, float]


@dataclass(frozen=True)
class ChannelGap:
    """One channel on held-out data: its gap before and after in nats a measurement, normalised
    rms and lag-one correlation before and after, and where it is worst."""

    channel: str
    gap_before: float
    gap_after: float
    rms_before: float
    rms_after: float
    correlation_before: float
    correlation_after: float
    worst_manoeuvre: str = ""


def p_text(p: float) -> str:
    """A p-value as a person reads it: far out the tail is extrapolated, and its exponent says
    nothing."""
    return f"{p:.0e}" if p >= LEAST_SHOWN_P else f"below {LEAST_SHOWN_P:.0e}"


GENERAL = (
    "drive figures of eight at two speeds, brake and accelerate hard on a straight, and stand "
    "still for half a minute in between"
)
GENERAL_FILM = "film more signs, near and far, in bends and at several speeds"


def advice(effect: str, confusable: Collection[str]) -> str:
    """The manoeuvre that tells an effect from those it is confusable with, nothing without any."""
    if not confusable:
        return ""
    known = [text for other in confusable if (text := _manoeuvre(effect, other))]
    general = GENERAL_FILM if CATALOGUE[effect].family == "camera" else GENERAL
    return "; ".join(dict.fromkeys(known)) or general


def _manoeuvre(one: str, other: str) -> str:
    """What tells two apart; nothing where none is known, or one is a formula."""
    for first, second in ((one, other), (other, one)):
        if first in CATALOGUE and second in (known := dict(CATALOGUE[first].told_apart)):
            return known[second]
    return ""
