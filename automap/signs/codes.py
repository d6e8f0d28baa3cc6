"""Which class a sign of somebody's list is: by our name, a national code or OpenStreetMap's word.

Codes are those of the table of classes (VzKat for DE, AS 1742 for AU), and those of the MUTCD and
the Vienna Convention whose faces the table has.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import cache

from automap.signs.classes import load_classes
from automap.signs.vocabulary import load_vocabulary

OTHER_CODES = {
    "US": {
        "R1-1": "regulatory--stop--g1",
        "R1-2": "regulatory--yield--g1",
        "R3-1": "regulatory--no-right-turn--g1",
        "R3-2": "regulatory--no-left-turn--g1",
        "R3-4": "regulatory--no-u-turn--g1",
        "R4-7": "regulatory--keep-right--g9",
        "R5-1": "regulatory--no-entry--g1",
        "R5-1A": "regulatory--wrong-way--g1",
        "W1-1L": "warning--turn-left--g1",
        "W1-1R": "warning--turn-right--g1",
        "W1-2L": "warning--curve-left--g2",
        "W1-2R": "warning--curve-right--g2",
        "W2-1": "warning--crossroads--g3",
        "W2-4": "warning--t-roads--g2",
        "W2-6": "warning--roundabout--g2",
        "W3-1": "warning--stop-ahead--g1",
        "W3-2": "warning--yield-ahead--g1",
        "W3-3": "warning--traffic-signals--g2",
        "W6-1": "warning--divided-highway--g1",
        "W6-2": "warning--divided-highway-ends--g1",
        "W6-3": "warning--two-way-traffic--g2",
        "W7-1": "warning--steep-descent--g2",
        "W8-5": "warning--slippery-road-surface--g2",
        "W11-1": "warning--bicycles-crossing--g3",
        "W11-2": "warning--pedestrians-crossing--g4",
        "W11-10": "warning--trucks-crossing--g1",
    },
    "VIENNA": {
        "A1A": "warning--curve-left--g1",
        "A1B": "warning--curve-right--g1",
        "A1C": "warning--double-curve-first-left--g1",
        "A4A": "warning--road-narrows--g1",
        "A7A": "warning--uneven-road--g1",
        "A9": "warning--slippery-road-surface--g1",
        "A12": "warning--pedestrians-crossing--g1",
        "A13": "warning--children--g1",
        "A14": "warning--bicycles-crossing--g1",
        "A15B": "warning--wild-animals--g1",
        "A16": "warning--roadworks--g3",
        "A17": "warning--traffic-signals--g1",
        "A18A": "warning--crossroads--g1",
        "A22": "warning--roundabout--g1",
        "A23": "warning--two-way-traffic--g1",
        "A32": "warning--other-danger--g1",
        "B1": "regulatory--yield--g1",
        "B2": "regulatory--stop--g1",
        "B3": "regulatory--priority-road--g1",
        "C1": "regulatory--no-entry--g1",
        "C2": "regulatory--road-closed-to-vehicles--g3",
        "C3C": "regulatory--no-bicycles--g1",
        "C3E": "regulatory--no-heavy-goods-vehicles--g1",
        "C3I": "regulatory--no-pedestrians--g2",
        "C11A": "regulatory--no-left-turn--g1",
        "C11B": "regulatory--no-right-turn--g1",
        "C12": "regulatory--no-u-turn--g1",
        "C13AA": "regulatory--no-overtaking--g1",
        "C13BA": "regulatory--no-overtaking-by-heavy-goods-vehicles--g1",
        "C17A": "regulatory--end-of-prohibition--g1",
        "C17B": "regulatory--end-of-maximum-speed-limit--g1",
        "C17C": "regulatory--end-of-no-overtaking--g1",
        "C17D": "regulatory--end-of-no-overtaking-by-heavy-goods-vehicles--g1",
        "C18": "regulatory--no-parking--g1",
        "C19": "regulatory--no-stopping--g1",
        "D3": "regulatory--roundabout--g1",
        "D4": "regulatory--bicycles-only--g1",
        "D5": "regulatory--pedestrians-only--g1",
        "E12A": "information--pedestrians-crossing--g1",
        "E13A": "information--hospital--g1",
        "E14A": "information--parking--g1",
    },
}
"""Convention on Road Signs and Signals of 1968 with the amendments of 1995, annex 1, where each
stands so (as the Dutch government prints it, wetten.overheid.nl, BWBV0004310). MUTCD, chapters 2B
and 2C, by the descriptions of its figures (mutcd.fhwa.dot.gov) and what others quote of it (W2-4:
engineerfix.com, W2-6: mutcd.info)."""

LIMITS = {"US": "R2-1", "VIENNA": "C14"}
"""Codes of the speed limits, whose number is written after them."""
SIDES = {
    "regulatory--keep-right--g1": "D2[R]",
    "regulatory--keep-left--g1": "D2[L]",
    "regulatory--no-bicycles--g2": "C3C",
    "regulatory--go-straight--g1": "D1A[S]",
    "regulatory--turn-left--g1": "D1A[L]",
    "regulatory--turn-right--g1": "D1A[R]",
    "regulatory--turn-left-ahead--g1": "D1A[AL]",
    "regulatory--turn-right-ahead--g1": "D1A[AR]",
    "regulatory--go-straight-or-turn-left--g1": "D1A[SL]",
    "regulatory--go-straight-or-turn-right--g1": "D1A[SR]",
}
"""Codes of the Convention that several faces share: one for each way that the arrow points, which
stands after them here (straight, left, right, ahead), and with the oblique bar or without."""

_OLD_VZKAT = {f"274-{50 + k}": f"274-{10 * k}" for k in range(1, 14)} | {"274-50": "274-5"}
"""The VzKat numbered speed limits from 274-50 up before 2017, by their value since."""

_CATALOGUES = ("DE", "AU", "US", "VIENNA")
"""Whose codes are known without their country."""

_PREFIX = re.compile(r"^(?:ZEICHEN|VERKEHRSZEICHEN|VZ|VZNR|STVO|Z|NR)?\.?:?(?=\d)")


def classes_of(texts: Sequence[str], country: str | None = None) -> list[str | None]:
    """The class of each text, "" for an empty one, None for one that is not understood.

    ``country`` (ISO 3166 alpha-2) is that of codes which do not name their own. Where a list has
    speed limits that only the old VzKat has, 274-50 and 274-60 are the old ones too.
    """
    found = readings_of(texts, country)
    return [names[0] if len(names) == 1 else None for names in found]


def readings_of(texts: Sequence[str], country: str | None = None) -> list[list[str]]:
    """The classes that each text may stand for, one of each face, as ``classes_of`` reads it."""
    codes = [_code(text, country) for text in texts]
    old = any(
        where in ("", "DE") and code in _OLD_VZKAT and not code.endswith("0")
        for where, code in codes
    )
    return [
        _classes(text, where, code, old) for text, (where, code) in zip(texts, codes, strict=True)
    ]


def countries_of(texts: Iterable[str]) -> Counter[str]:
    """How many different codes say whose they are (ISO 3166, or of no country, VIENNA), or stand in
    one country's catalogue alone."""
    told: Counter[str] = Counter()
    for where, code in {_code(text, None) for text in texts}:
        having = [c for c in _CATALOGUES if (c, code) in _by_code()]
        told[where or (having[0] if len(having) == 1 else "")] += 1
    del told[""]
    return told


def _code(text: str, country: str | None) -> tuple[str, str]:
    """Country and code in the table's form: ``de: Zeichen 274 [60]`` is DE, 274-60."""
    # of "274-60,1040-30" what follows the comma are plates beneath
    first = re.split(r"[;,]", text.upper())[0]
    where, _, rest = first.rpartition(":")
    where = where.strip() or (country or "").upper()
    rest = re.sub(r"[\s_]+", "", rest).replace("(", "[").replace(")", "]")
    if where in ("", "DE", "AT", "CH") or rest[:1] in "ZVN":
        rest = _PREFIX.sub("", rest)
        # others begin with a letter, and have the number in brackets
        if rest[:1].isdigit():
            rest = re.sub(r"\[(\d+)(?:KM/?H)?\]$", r"-\1", rest.replace(".", "-"))
    return where, rest


def _classes(text: str, where: str, code: str, old: bool) -> list[str]:
    bare = text.strip()
    if not bare or bare in load_classes() or bare in load_vocabulary().classes:
        return [bare]
    if bare in load_vocabulary().groups.values():
        return [bare]
    if where in ("", "DE") and code in _OLD_VZKAT and (old or not code.endswith("0")):
        code = _OLD_VZKAT[code]
    limit = where in LIMITS and re.fullmatch(rf"{LIMITS[where]}\[?-?(\d+)\]?", code)
    if limit:
        name = f"regulatory--maximum-speed-limit-{limit[1]}--g1"
        return [name] if name in load_classes() else []
    table = _by_code()
    if where:
        # who follows the Convention has numbers of their own: the French B1 is no entry
        found = [table[where, c] for c in (code, code.rstrip("ABC")) if (where, c) in table][:1]
        if where == "VIENNA" and not found:
            found = [name for name, own in SIDES.items() if own.split("[")[0] == code]
    else:
        names = [table[c, code] for c in _CATALOGUES if (c, code) in table]
        found = list({face_of(name): name for name in reversed(names)}.values())
    # a code that two catalogues give to different signs is neither's
    return found if len(found) == 1 else _by_word().get(bare.lower(), found)


@cache
def _by_code() -> dict[tuple[str, str], str]:
    table: dict[tuple[str, str], str] = {}
    for entry in load_classes().values():
        for country, code in entry.codes.items():
            table.setdefault((country, code.upper()), entry.name)
    for country, codes in OTHER_CODES.items():
        table |= {(country, code): name for code, name in codes.items()}
    for name, code in SIDES.items():
        table.setdefault(("VIENNA", code), name)
    return table


@cache
def _by_word() -> dict[str, list[str]]:
    """Names in words, "maximum speed limit 60", and OpenStreetMap's: a class of each face."""
    words: dict[str, dict[str, str]] = {}
    # give-way signs of roundabouts share the word with the one that everybody means
    give_way = {"give_way": ["regulatory--yield--g1"], "give way": ["regulatory--yield--g1"]}
    for entry in load_classes().values():
        bare = face_of(entry.name)
        short = bare.split("--")[-1]
        for word in {bare, short, short.replace("-", " "), short.replace("-", "_")}:
            words.setdefault(word, {}).setdefault(bare, entry.name)
        if entry.osm:
            words.setdefault(entry.osm, {}).setdefault(bare, entry.name)
    # the first of several drawings of one sign serves
    return {word: list(faces.values()) for word, faces in words.items()} | give_way


def face_of(class_name: str) -> str:
    """A class without the number of its drawing: what is written on ``stop--g1`` and ``--g2`` is
    the same."""
    return re.sub(r"--(g\d+|[a-z]{2})$", "", class_name)
