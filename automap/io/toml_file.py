"""TOML files that people write by hand."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from automap.errors import ConfigError


def read_toml(path: Path, what: str = "file") -> dict[str, Any]:
    """The content of a TOML file; ConfigError names the file, the place and what to do.

    ``what`` is said of a file that is not there.
    """
    try:
        raw = path.read_bytes()
    except FileNotFoundError:
        raise ConfigError(f"{path}: there is no such {what}; check the path.") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror}); check the path.") from None
    return parse_toml(path, raw)


def parse_toml(path: Path, raw: bytes) -> dict[str, Any]:
    """The same of bytes that were read from ``path``.

    A byte order mark and other line ends, which some editors write, are taken as they are meant.
    """
    try:
        text = raw.decode("utf-8").removeprefix("\ufeff")
        return tomllib.loads(text.replace("\r\n", "\n").replace("\r", "\n"))
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: byte {error.start} is not UTF-8; save it as UTF-8.") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML: {error}; correct that place.") from None
    except RecursionError:
        raise ConfigError(f"{path}: its values are nested too deeply; correct it.") from None
