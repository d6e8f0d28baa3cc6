"""What the name of a column in a foreign table means: its words, axis and unit."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from functools import cache

from automap.io import header_words as words_of
from automap.io.table_form import TableKind
from automap.io.table_units import UNITS, Quantity, unit_named

_BRACKET = re.compile(r"[\[({]([^\[\](){}]*)[\])}]")
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_LAST = re.compile(r"(?:\bin\s+|[,;:|]\s*|\s)(\S+)$")
_KINDS = {
    "imu": words_of.IMU,
    "gnss": words_of.GNSS,
    "odometer": words_of.ODOMETER,
    "arrival": words_of.ARRIVAL,
}
_UNIT_WORDS = frozenset(
    [
        "rad",
        "deg",
        "m",
        "s",
        "ms",
        "us",
        "ns",
        "km",
        "h",
        "kmh",
        "kph",
        "mph",
        "mps",
        "kn",
        "knots",
        "c",
        "dps",
        "g",
        "mg",
        "e7",
        "t",
    ]
)


@dataclass(frozen=True)
class HeaderName:
    """A column's name taken apart: ``words`` in lower case without accents, ``bracket`` what
    stood in brackets."""

    text: str
    words: tuple[str, ...]
    bracket: str

    def unit(self, quantity: Quantity) -> str | None:
        """The unit that the name tells, None when it tells none."""
        if self.bracket:
            return unit_named(self.bracket, quantity)
        for n in (3, 2):
            if len(self.words) >= n:
                written = _written(self.words[-n:])
                told = {q for q in UNITS if any(unit_named(text, q) for text in written)}
                if quantity in told and (len(self.words) > n or quantity == "time"):
                    return next(filter(None, (unit_named(text, quantity) for text in written)))
                if told:
                    # the h of km/h is no hour
                    return None
        last = _LAST.search(self.text.strip())
        found = unit_named(last.group(1), quantity) if last else None
        if found is None and self.words and (len(self.words) > 1 or quantity == "time"):
            return unit_named(self.words[-1], quantity)
        return found


def _written(words: tuple[str, ...]) -> tuple[str, ...]:
    """How the words at the end of a name may have been written as a unit."""
    return "/".join(words), "".join(words), f"{words[0]}/{''.join(words[1:])}"


@dataclass(frozen=True)
class Meaning:
    """What the words of a name say: ``ideas`` of the vocabulary, and how many words are in none."""

    ideas: frozenset[str]
    unknown: int


def take_apart(text: str) -> HeaderName:
    """A column's name as the vocabulary sees it."""
    bracket = " ".join(_BRACKET.findall(text)).strip()
    bare = unicodedata.normalize("NFKD", _BRACKET.sub(" ", text).replace("ß", "ss"))
    plain = "".join(c for c in bare if not unicodedata.combining(c))
    return HeaderName(text, tuple(word.lower() for word in _WORD.findall(plain)), bracket)


@cache
def _vocabulary(kind: TableKind) -> tuple[dict[str, str], tuple[tuple[str, str], ...]]:
    """Word -> idea, and beginnings of words with theirs."""
    whole: dict[str, str] = {}
    begin: list[tuple[str, str]] = []
    for table in (words_of.COMMON, _KINDS[kind]):
        for idea, listed in table.items():
            for word in listed.split():
                if word.endswith("*"):
                    begin.append((word[:-1], idea))
                else:
                    whole[word] = idea
    return whole, tuple(begin)


def _ideas(word: str, kind: TableKind) -> tuple[str, ...] | None:
    """The ideas of a word, of the two words that it is made of, or None."""
    whole, begin = _vocabulary(kind)
    if word in words_of.COMPOUNDS:
        return words_of.COMPOUNDS[word]
    if word in whole:
        return (whole[word],)
    if word in words_of.NEUTRAL:
        return ()
    started = next((idea for start, idea in begin if word.startswith(start)), None)
    if started is not None:
        return (started,)
    for cut in range(3, len(word) - 2):
        parts = [
            (whole[part],) if part in whole else () if part in words_of.NEUTRAL else None
            for part in (word[:cut], word[cut:])
        ]
        if parts[0] is not None and parts[1] is not None:
            return (*parts[0], *parts[1])
    return None


def meaning(words: tuple[str, ...], kind: TableKind) -> Meaning:
    """What words say in a table of a kind; units at the end say nothing."""
    kept = list(words)
    while len(kept) > 1 and (kept[-1] in _UNIT_WORDS or kept[-1].isdigit()):
        kept.pop()
    ideas: set[str] = set()
    unknown = 0
    for at, word in enumerate(kept):
        # v_acc and h_acc are parted where vAcc is
        joined = word + (kept[at + 1] if len(word) == 1 and at + 1 < len(kept) else "")
        found = _ideas(joined if joined in words_of.COMPOUNDS else word, kind)
        if found is None:
            unknown += 1
        else:
            ideas.update(found)
    if kept == ["gps"] and len(words) == 2 and words[1] in ("s", "us", "ns"):
        # as we write it; "ms" is a speed as well
        ideas.add("time")
    return Meaning(frozenset(ideas), unknown)


def role_named(name: HeaderName, kind: TableKind) -> tuple[str, tuple[int, int]] | None:
    """Our name of a column, times and triads apart, and how far from the best way to say it: how
    many of its words say nothing, and how many ways are preferred."""
    said = meaning(name.words, kind)
    for role, rules in words_of.RULES[kind].items():
        for rank, rule in enumerate(rules.split(", ")):
            if frozenset(rule.split("+")) == said.ideas:
                return role, (said.unknown, rank)
    return None


def triad_axis(name: HeaderName) -> tuple[str, int, tuple[str, ...]] | None:
    """Of an inertial column: "g" or "a", axis 0 to 2, and the words that its triad shares."""
    words = [word for word in name.words if word not in words_of.NEUTRAL or word == "motion"]
    if "force" in words:
        # GForceX: no gyro's g, but the unit
        words = [word for word in words if word != "g"]
    said = meaning(tuple(words), "imu").ideas
    for axis, turn in enumerate(("roll", "pitch", "yaw")):
        if turn in said:
            turning = said & {"rate", "speed", "gyro", "angular"} and not said & {"accel", "other"}
            return ("g", axis, ("turn",)) if turning else None
    letters = [word for word in words if word in ("x", "y", "z")]
    if len(letters) == 1:
        letter, stem = letters[0], [word for word in words if word != letters[0]]
    else:
        # gx, accelZ, wx_rad_s: the axis ends a word
        at = next((i for i, w in enumerate(words) if w[-1:] in "xyz" and len(w) > 1), None)
        if at is None or letters:
            return None
        letter, stem = words[at][-1], [*words[:at], words[at][:-1], *words[at + 1 :]]
    said = meaning(tuple(stem), "imu").ideas
    if "other" in said or "time" in said:
        return None
    turning = "gyro" in said or "angular" in said
    if turning == ("accel" in said):
        return None
    return "g" if turning else "a", "xyz".index(letter), tuple(stem)
