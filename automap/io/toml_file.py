"""TOML: files that people write by hand, and values as such a file has them."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, get_args

import numpy as np

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
        data = tomllib.loads(text.replace("\r\n", "\n").replace("\r", "\n"))
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: byte {error.start} is not UTF-8; save it as UTF-8.") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML: {error}; correct that place.") from None
    except RecursionError:
        raise ConfigError(f"{path}: its values are nested too deeply; correct it.") from None
    except ValueError:
        # an integer of more digits than Python turns into a number
        raise ConfigError(
            f"{path}: a whole number in it has thousands of digits; correct it."
        ) from None
    large = next((key for key, value in _leaves(data, "") if _is_large(value)), None)
    if large is not None:
        raise ConfigError(
            f"{path}: {large} is a whole number of more than 64 bits, which TOML does not have; "
            "correct it."
        )
    return data


def no_boolean(value: Any, annotation: Any) -> Any:
    """A value as it is; ValueError where true or false stands in it and its field, of the type
    ``annotation``, has numbers: Python takes them for 1 and 0."""
    kinds = set(_kinds(annotation))
    numbers = kinds & {int, float} and bool not in kinds
    if numbers and any(isinstance(leaf, bool) for _, leaf in _leaves(value, "")):
        raise ValueError("true and false are no numbers; write the number")
    return value


def _kinds(annotation: Any) -> Iterator[Any]:
    """The types that a type is made of."""
    yield annotation
    for part in get_args(annotation):
        yield from _kinds(part)


def _leaves(value: Any, key: str) -> Iterator[tuple[str, Any]]:
    """The values that are no tables or arrays, with dotted keys."""
    if isinstance(value, dict):
        for name, inside in value.items():
            yield from _leaves(inside, f"{key}.{name}" if key else str(name))
    elif isinstance(value, list):
        for inside in value:
            yield from _leaves(inside, key)
    else:
        yield key, value


def _is_large(value: Any) -> bool:
    return isinstance(value, int) and not -(1 << 63) <= value < 1 << 63


def toml_value(value: Any, number: Callable[[float], str] = repr) -> str:
    """A text, number, truth value, array of any depth or table as TOML writes it in one line.

    ``number`` writes floats; as it stands they keep all digits.
    """
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, str):
        # JSON's escapes are TOML's, which has one for DEL too; half characters of odd file names
        # have none
        whole = value.encode("utf-8", "replace").decode("utf-8")
        return json.dumps(whole, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        inside = (f"{toml_value(str(k))} = {toml_value(v, number)}" for k, v in value.items())
        return f"{{ {', '.join(inside)} }}" if value else "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(toml_value(item, number) for item in value)}]"
    if isinstance(value, bool):
        return "true" if value else "false"
    return number(value) if isinstance(value, float) else repr(value)
