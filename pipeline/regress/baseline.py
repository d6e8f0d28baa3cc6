"""The file of stored figures: one JSON for all drives, a few kB each."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from automap import __version__
from automap.errors import InputError
from automap.io.atomic import plain, write_text
from automap.io.json_text import parse_json
from automap.regression.record import DriveRecord, from_json, to_json

SCHEMA = "automap.regression/1"


def read_baseline(path: Path) -> dict[str, DriveRecord]:
    """Stored figures by the drive's name; empty when there is no such file.

    Raises InputError, naming the place, for a file that cannot be read or is another.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return {}
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path} cannot be read ({_reason(error)}); check the file.") from error
    try:
        stored: Any = parse_json(text)
    except ValueError as error:
        raise InputError(
            f"{path} is not valid JSON ({error}); restore it, or delete it and store the figures "
            "anew with --update."
        ) from None
    schema = stored.get("schema") if isinstance(stored, dict) else None
    if schema != SCHEMA:
        raise InputError(
            f"{path} is no file of stored figures that this version reads (schema {schema!r}, "
            f"not {SCHEMA!r}); name another with --baseline."
        )
    records = {}
    drives = stored.get("drives")
    for name, value in drives.items() if isinstance(drives, dict) else ():
        try:
            records[str(name)] = from_json(value)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(
                f"{path}: the figures of {name} are damaged ({type(error).__name__}: {error}); "
                "restore the file, or delete it and store the figures anew with --update."
            ) from None
    return records


def _reason(error: OSError | UnicodeDecodeError) -> str:
    if isinstance(error, UnicodeDecodeError):
        return "it is no text"
    return error.strerror or str(error)


def write_baseline(path: Path, records: dict[str, DriveRecord]) -> None:
    """Write the figures, a line for each kind of them, so that versions can be compared."""
    drives = []
    for name in sorted(records):
        lines = [
            f"   {json.dumps(key)}: {json.dumps(plain(value), separators=(',', ':'))}"
            for key, value in to_json(records[name]).items()
        ]
        drives.append(f"  {json.dumps(name)}: {{\n" + ",\n".join(lines) + "\n  }")
    body = ",\n".join(drives)
    head = f' "schema": {json.dumps(SCHEMA)},\n "automap": {json.dumps(__version__)},\n'
    write_text(path, f'{{\n{head} "drives": {{\n{body}\n }}\n}}\n')
