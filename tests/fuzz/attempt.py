"""One damaged file through its reader: what came of it."""

from __future__ import annotations

import logging
import tempfile
import time
import traceback
import warnings
from dataclasses import dataclass
from pathlib import Path

from automap.errors import AutoMapError
from tests.unit.broken_readers import reader_of

SLOW_S = 10.0
"""A reader's time for 64 KB: a hundred times what the slowest takes, with other work beside it."""

MOST_CHARACTERS = 1000
"""Of an error's sentence; a garbled file must not be told back whole."""


@dataclass(frozen=True)
class Outcome:
    """``kind``: read, refused (one of our errors), or what is wrong; ``said``: its words."""

    kind: str
    said: str

    @property
    def good(self) -> bool:
        return self.kind in ("read", "refused")


def attempt(name: str, data: bytes) -> Outcome:
    """Read ``data`` as a file of the harness ``name``."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        logging.disable(logging.CRITICAL)
        work = Path(folder) / "work"
        work.mkdir()
        path = Path(folder) / (f"{name}.zip" if name == "phone_zip" else f"{name}.dat")
        if name.endswith("_parquet"):
            path = path.with_suffix(".parquet")
        path.write_bytes(data)
        started = time.monotonic()
        try:
            reader_of(name)(path, work)
            outcome = Outcome("read", "")
        except AutoMapError as error:
            said = str(error).replace(folder, "")
            whole = "\n" not in said and len(said) <= MOST_CHARACTERS
            outcome = Outcome("refused" if whole else "long sentence", said)
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{type(error).__name__} {Path(place.filename).name}:{place.lineno}"
            kind = "warning" if isinstance(error, Warning) else "crash"
            outcome = Outcome(kind, f"{where} {str(error)[:200]}")
        finally:
            logging.disable(logging.NOTSET)
    return outcome if time.monotonic() - started < SLOW_S else Outcome("slow", name)
