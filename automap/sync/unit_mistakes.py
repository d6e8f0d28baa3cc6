"""Which mistake of a unit makes a receiver's velocities so many times those of its positions."""

from __future__ import annotations

import math
from dataclasses import dataclass

from automap.sync import limits
from automap.sync.path_match import Estimate


@dataclass(frozen=True)
class UnitMistake:
    """Speeds in ``logged`` stand where those in ``expected`` belong, ``factor`` times the truth."""

    logged: str
    expected: str
    factor: float


ON_THE_ROAD = {"m/s": 1.0, "km/h": 1.0 / 3.6, "knots": 1852.0 / 3600.0, "mph": 0.44704}
"""Units of a vehicle's speed, in m/s."""
OF_PROGRAMS = {"ft/s": 0.3048, "cm/s": 0.01, "mm/s": 0.001}
"""Units, in m/s, that only programs write, and where m/s belong."""
HUNDREDTHS = 0.6
"""Speeds are so many times those of positions where hundredths of a degree stand for minutes
(48.13 deg as 48 deg 13'); the other way round they are 1 / 0.6 times."""
MISTAKES = tuple(
    UnitMistake(logged, expected, (ON_THE_ROAD | OF_PROGRAMS)[expected] / in_m_s)
    for logged, in_m_s in (ON_THE_ROAD | OF_PROGRAMS).items()
    for expected in (ON_THE_ROAD if logged in ON_THE_ROAD else ("m/s",))
    if logged != expected
)
"""Each unit that may stand where another belongs."""


def unit_mistake(scale: Estimate | None) -> tuple[UnitMistake | None, bool]:
    """The mistake that a scale comes from, and whether it is wrong beyond doubt.

    Three explanations: a sound receiver's, near one; a mistaken unit's, near a quotient of two
    units; any other, by a scale of which nothing is known. Wrong is what is less likely the first
    by odds of a million.
    """
    if scale is None or scale.value <= 0.0:
        return None, False
    log_scale = math.log(scale.value)
    sd = math.hypot(scale.sd / scale.value, limits.SOUND_SCALE_SD)

    def nats(log_expected: float) -> float:
        return -0.5 * ((log_scale - log_expected) / sd) ** 2

    any_other = math.log(sd * math.sqrt(2.0 * math.pi) / (2.0 * limits.ANY_LOG_SCALE))
    best = max(MISTAKES, key=lambda mistake: nats(math.log(mistake.factor)))
    by_unit = nats(math.log(best.factor))
    wrong = max(by_unit, any_other) - nats(0.0) > limits.CERTAIN_LEAD_NATS
    return (best if wrong and by_unit > any_other else None), wrong


def by_minutes(scale: Estimate) -> str:
    """What else than a unit of speed a scale may be: minutes of arc that are no minutes."""
    for factor, text in (
        (HUNDREDTHS, ", or as degrees whose hundredths were read as minutes (48.13 deg as 48 13')"),
        (
            1.0 / HUNDREDTHS,
            ", or as minutes that were read as hundredths of degrees (48 13' as 48.13 deg)",
        ),
    ):
        if abs(scale.value / factor - 1.0) < 2.0 * math.hypot(
            scale.sd / factor, limits.SOUND_SCALE_SD
        ):
            return f"{text}: then the positions are wrong"
    return ""
