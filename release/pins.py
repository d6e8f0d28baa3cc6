"""The lock files: packages with versions and the hashes of their files."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RUNTIME, BUILD, DEV = "requirements.lock", "requirements-build.lock", "requirements-dev.lock"


@dataclass(frozen=True)
class Pin:
    """A package at a version; ``hashes`` are SHA-256 of its files in hexadecimal."""

    name: str
    version: str
    hashes: tuple[str, ...]


def read_pins(path: Path) -> list[Pin]:
    """The pins of a lock file; ValueError where a line is none."""
    text = re.sub(r"\s*\\\n\s*", " ", path.read_text(encoding="utf-8"))
    pins = []
    for line in text.splitlines():
        if not line.strip() or line.startswith("#"):
            continue
        found = re.fullmatch(r"([\w.-]+)==(\S+)((?: --hash=sha256:[0-9a-f]{64})*)", line.strip())
        if found is None:
            raise ValueError(f"{path}: {line[:60]!r} pins no package")
        hashes = tuple(re.findall(r"sha256:(\w+)", found[3]))
        pins.append(Pin(normal(found[1]), found[2], hashes))
    return pins


def normal(name: str) -> str:
    """A package name as indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()
