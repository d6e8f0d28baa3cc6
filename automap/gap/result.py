"""What the gap finder says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from automap.gap.dictionary import coefficient_names
from automap.gap.fit import Fit
from automap.gap.identifiability import Identifiability
from automap.gap.locate import Place
from automap.gap.misfit import Misfit
from automap.gap.model import GapModel

LEAST_SHOWN_P = 1e-12


@dataclass(frozen=True)
class ParameterValue:
    """A number of an effect with one sigma and unit."""

    value: float
    sd: float
    unit: str


@dataclass(frozen=True)
class Finding:
    """A missing effect by name.

    ``evidence_nats`` log Bayes factor against the model without it; ``p_value`` chance that the
    strongest of all candidates reaches as much where nothing is missing; gaps before and after
    it was added, nats an epoch on held-out data; ``confusable_with`` effects that this data
    cannot tell from it; ``advice`` the manoeuvre that would.
    """

    effect: str
    parameters: Mapping[str, ParameterValue]
    evidence_nats: float
    p_value: float
    gap_before: float
    gap_after: float
    confusable_with: tuple[str, ...] = ()
    advice: str = ""


@dataclass(frozen=True)
class Term:
    """One regressor on one channel: coefficient and sd in the unit of the channel per unit of the
    quantity."""

    channel: str
    text: str
    coefficient: float
    sd: float


@dataclass(frozen=True)
class NoiseClaim:
    """A level of noise that is not as stated: ``factor`` on what data sheet or preset says, with
    the nats by which the drives are likelier with it."""

    level: str
    factor: float
    evidence_nats: float
    p_value: float


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
    ``terms`` all of a formula that acts in several places, that of ``channel`` first.

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


@dataclass(frozen=True)
class GapResult:
    """Everything that a search found.

    ``formulas`` what no effect of the library explains, ``model`` the new one, ``places`` where the
    gap was, ``held_out`` the fits of the held-out data before and after, ``unclear`` what the
    fitted drives cannot tell, ``misfits`` what no candidate explains, ``noise_claims`` noise that
    is not as stated, ``refused`` the strongest candidate that is not named, ``costs`` what each
    effect by name, or level of noise, costs on held-out data, ``kept_out`` what these spoke
    against, ``positions`` how well they are predicted.
    """

    gap_before: float
    gap_after: float
    channels: tuple[ChannelGap, ...]
    findings: tuple[Finding, ...]
    noise: Mapping[str, float]
    formulas: tuple[Unexplained, ...]
    verdict: str
    model: GapModel
    base: GapModel
    sync: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    places: tuple[Place, ...] = ()
    held_out: tuple[tuple[Fit, ...], tuple[Fit, ...]] = ((), ())
    unclear: Identifiability = field(default_factory=Identifiability)
    misfits: tuple[Misfit, ...] = ()
    noise_claims: tuple[NoiseClaim, ...] = ()
    refused: tuple[Refused, ...] = ()
    costs: Mapping[str, Cost] = field(default_factory=dict)
    kept_out: tuple[KeptOut, ...] = ()
    positions: HeldPositions | None = None


def p_text(p: float) -> str:
    """A p-value as a person reads it: far out the tail is extrapolated, and its exponent says
    nothing."""
    return f"{p:.0e}" if p >= LEAST_SHOWN_P else f"below {LEAST_SHOWN_P:.0e}"
