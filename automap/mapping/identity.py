"""Names of map signs that stay the same from one merge to the next."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence

import numpy as np

from automap.mapping.sightings import DriveSigns

_ALPHABET = "0123456789abcdefghjkmnpqrstvwxyz"
_LETTERS = 8
"""2^40 names."""


def sighting_key(drive: DriveSigns, sign_id: str) -> str:
    """What names one sighting among all drives."""
    return f"{drive_key(drive)}|{sign_id}"


def drive_key(drive: DriveSigns) -> str:
    """What tells a drive from others: its own key, else name and day."""
    if drive.key:
        return drive.key
    day = int(drive.start_gps_s // 86400) if np.isfinite(drive.start_gps_s) else -1
    return f"{drive.name}|{day}"


def name_signs(keys: Sequence[str], kept: Mapping[int, str], taken: set[str]) -> list[str]:
    """Names of the signs with founders ``keys``; those in ``kept`` have theirs already.

    No name of ``taken`` (an older map's) is given to another sign.
    """
    used = set(taken) | set(kept.values())
    names = []
    for number, key in enumerate(keys):
        if number in kept:
            names.append(kept[number])
            continue
        attempt = 0
        while (name := _name(key, attempt)) in used:
            attempt += 1
        used.add(name)
        names.append(name)
    return names


def _name(key: str, attempt: int) -> str:
    text = key if attempt == 0 else f"{key}|{attempt}"
    value = int.from_bytes(hashlib.sha256(text.encode("utf-8", "replace")).digest()[:8], "big")
    return "m" + "".join(_ALPHABET[value >> 5 * k & 31] for k in range(_LETTERS))
