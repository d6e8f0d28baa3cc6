"""What a u-blox receiver says of itself (UBX-MON-VER).

Reference: u-blox 8/M8 receiver description (UBX-13003221), 32.16.13.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

_FIRST_VALSET = 27.0
_FIRST_PVT = 14.0


@dataclass(frozen=True)
class Version:
    """What a receiver says of itself. ``protocol`` is NaN where it does not tell."""

    software: str
    hardware: str
    protocol: float = float("nan")
    model: str = ""

    @property
    def by_keys(self) -> bool:
        """Whether it is set by UBX-CFG-VALSET."""
        return self.protocol >= _FIRST_VALSET

    @property
    def has_pvt(self) -> bool:
        """Whether it can send UBX-NAV-PVT."""
        return self.protocol >= _FIRST_PVT

    def __str__(self) -> str:
        protocol = f", protocol {self.protocol:.2f}" if self.protocol == self.protocol else ""
        return f"{self.model or 'u-blox'} (firmware {self.software}{protocol})"


def parse_version(payload: bytes) -> Version:
    """UBX-MON-VER: firmware, hardware and, where they are told, protocol and model."""
    texts = [_text(payload[0:30]), _text(payload[30:40])]
    extensions = [_text(payload[i : i + 30]) for i in range(40, len(payload) - 29, 30)]
    everything = "\n".join(extensions)
    protocol = re.search(r"PROTVER[ =]*(\d+\.\d+)", everything)
    model = re.search(r"MOD=([\w-]+)", everything)
    number = float(protocol.group(1)) if protocol else _protocol_of(texts[1])
    return Version(texts[0], texts[1], number, model.group(1) if model else "")


def _protocol_of(hardware: str) -> float:
    """Protocol of receivers that do not tell it, by generation 5, 6, 7; unknown ones as the
    oldest, which every later one of this kind understands."""
    return {"00040005": 11.0, "00040007": 13.0, "00070000": 14.0}.get(hardware, 11.0)


def _text(raw: bytes) -> str:
    return raw.split(b"\0", 1)[0].decode("latin-1").strip()
