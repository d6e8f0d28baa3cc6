"""Units of table columns: how files and manifests write them, and what one is in SI."""

from __future__ import annotations

import re
import unicodedata
from typing import Literal

import numpy as np

from automap.earth import STANDARD_GRAVITY
from automap.io.angle_text import DEGREES_MINUTES, SPELLED_OUT, from_degrees_minutes
from automap.records import FloatArray

Quantity = Literal["rate", "acceleration", "speed", "length", "angle", "temperature", "time"]

_KNOT = 1852.0 / 3600.0
_DEGREE = np.pi / 180.0

UNITS: dict[Quantity, dict[str, float]] = {
    "rate": {"rad/s": 1.0, "deg/s": _DEGREE, "mrad/s": 1e-3, "mdeg/s": 1e-3 * _DEGREE,
             "rpm": 6.0 * _DEGREE},
    "acceleration": {"m/s^2": 1.0, "g": STANDARD_GRAVITY, "mg": 1e-3 * STANDARD_GRAVITY,
                     "cm/s^2": 1e-2},
    "speed": {"m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704, "knots": _KNOT, "cm/s": 1e-2,
              "mm/s": 1e-3, "ft/s": 0.3048},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "km": 1e3, "ft": 0.3048},
    "angle": {"rad": 1.0, "deg": _DEGREE, "gon": 0.9 * _DEGREE, "1e-7 deg": 1e-7 * _DEGREE,
              "1e-6 deg": 1e-6 * _DEGREE, "1e-5 deg": 1e-5 * _DEGREE,
              DEGREES_MINUTES: _DEGREE, SPELLED_OUT: _DEGREE},
    "temperature": {"degC": 1.0, "degF": 5.0 / 9.0, "K": 1.0},
    "time": {"ns": 1.0, "us": 1e3, "ms": 1e6, "s": 1e9, "min": 6e10, "h": 3.6e12, "d": 8.64e13},
}  # fmt: skip
"""Unit -> factor to rad/s, m/s^2, m/s, m, rad, degC and, of time, ns; of degrees with minutes once
they are degrees."""

_ZERO = {"degF": -32.0, "K": -273.15}

_SPELLINGS: dict[str, tuple[str, ...]] = {
    "rad/s": ("rads", "radian/s", "radians/s", "rad/sec", "rps", "radpersec", "1/s"),
    "deg/s": ("dps", "degs", "degree/s", "degrees/s", "deg/sec", "grad/s", "gradi/s", "graden/s",
              "grados/s", "degres/s", "°/s", "°/sec", "°s", "degpersec"),
    "mdeg/s": ("mdps", "m°/s"),
    "rpm": ("u/min", "1/min", "tr/min", "giri/min"),
    "m/s^2": ("m/s2", "m/s/s", "ms2", "ms-2", "mps2", "m/sec2", "m/sec^2", "m/s**2", "m/s²"),
    "g": ("gs", "gee", "g0", "gn"),
    "mg": ("milli-g", "millig"),
    "cm/s^2": ("gal", "cm/s2"),
    "m/s": ("mps", "ms", "m/sec", "ms-1", "meter/s", "meters/s", "metres/s", "meterspersecond"),
    "km/h": ("kmh", "kph", "km/hr", "kmph", "km/std", "km/u"),
    "mph": ("mi/h", "miles/h"),
    "knots": ("kn", "kt", "kts", "knot", "knoten", "nodi", "nudos", "noeuds", "nœuds"),
    "ft/s": ("fps", "feet/s"),
    "m": ("meter", "meters", "metre", "metres", "metri", "metros", "mtr"),
    "cm": ("centimeter", "centimetres"),
    "mm": ("millimeter", "millimetres"),
    "km": ("kilometer", "kilometers"),
    "ft": ("feet", "foot"),
    "deg": ("degree", "degrees", "grad", "grado", "gradi", "grados", "graden", "degre", "degres",
            "°", "wgs84", "dd", "decimal degrees"),
    "rad": ("radian", "radians", "radiant"),
    "gon": ("gons", "gradian", "gradians", "neugrad", "400/turn"),
    DEGREES_MINUTES: ("ddmm", "dddmm.mmmm", "ddmm.mm", "dm"),
    SPELLED_OUT: ("d m s", "deg min sec", "degrees minutes seconds"),
    "1e-6 deg": ("1e-6deg", "dege6", "e6", "1e6", "deg*1e6", "deg*1e-6", "1e-6", "microdegrees"),
    "1e-5 deg": ("1e-5deg", "dege5", "e5", "1e5", "deg*1e5", "deg*1e-5", "1e-5"),
    "1e-7 deg": ("1e-7deg", "dege7", "e7", "1e7", "deg*1e7", "deg*1e-7", "1e-7"),
    "degC": ("c", "°c", "celsius", "grad c", "deg c"),
    "degF": ("f", "°f", "fahrenheit", "deg f"),
    "K": ("kelvin",),
    "ns": ("nanosecond", "nanoseconds", "nsec", "nanos", "nanosekunden"),
    "us": ("µs", "μs", "microsecond", "microseconds", "usec", "micros", "mikrosekunden"),
    "ms": ("millisecond", "milliseconds", "msec", "millis", "millisekunden", "millisecondes",
           "milisegundos", "millisecondi", "milliseconden"),
    "s": ("sec", "secs", "second", "seconds", "sekunde", "sekunden", "sek", "seconde", "secondes",
          "segundo", "segundos", "secondi", "seconden", "seg"),
    "min": ("minute", "minutes", "minuten"),
    "h": ("hour", "hours", "std", "stunden"),
}  # fmt: skip


def _plain(text: str) -> str:
    return re.sub(r"\s*([/^*])\s*", r"\1", text.strip().strip("[](){}").strip()).lower()


_KNOWN: dict[Quantity, dict[str, str]] = {
    quantity: {
        spelling: unit
        for unit in units
        for spelling in (_plain(unit), *map(_plain, _SPELLINGS.get(unit, ())))
    }
    for quantity, units in UNITS.items()
}


def unit_named(text: str, quantity: Quantity) -> str | None:
    """The unit that a text such as ``[°/s]`` or ``km/h`` means, None when it is none of the
    quantity's."""
    known = _KNOWN[quantity]
    plain = _plain(unicodedata.normalize("NFC", text))
    bare = "".join(c for c in unicodedata.normalize("NFKD", plain) if not unicodedata.combining(c))
    return known.get(plain) or known.get(bare) or known.get(plain.replace(" ", ""))


RATED_C = (-40.0, 85.0)
"""Data sheets of consumer sensors: where they may be operated, degC."""


def doubtful_temperature(name: str, temp_c: FloatArray) -> str | None:
    """A sentence where temperatures [n] leave what sensors are rated for: another unit, likely.

    A unit that the header does not name cannot be told within that: 73 is a warm room in degF and a
    sensor behind a windscreen in degC.
    """
    known = temp_c[np.isfinite(temp_c)]
    low, high = RATED_C
    if not len(known) or (known.min() >= low and known.max() <= high):
        return None
    return (
        f"{name}: temperatures from {known.min():.4g} to {known.max():.4g} degC, outside the "
        f"{low:g} to {high:g} that sensors are rated for; if they are degF or K, say so in the "
        "header, as in temp_c [degF], or in drive.toml"
    )


def to_si(values: FloatArray, unit: str, quantity: Quantity) -> FloatArray:
    """Values [n] or [n, k] of a unit in the quantity's SI unit (degC, and ns of time)."""
    if unit == DEGREES_MINUTES:
        values = from_degrees_minutes(values)
    shifted = values + _ZERO[unit] if unit in _ZERO else values
    factor = UNITS[quantity][unit]
    return shifted if factor == 1.0 else np.asarray(shifted * factor)
