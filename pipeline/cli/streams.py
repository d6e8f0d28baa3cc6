"""Output that outlasts its reader: ``automap run ... | head -1`` does all of its work."""

from __future__ import annotations

import os
import sys
from typing import Any, TextIO

from automap.errors import StageError


class Outlasting:
    """A text stream whose text goes nowhere once its reader has gone; StageError where it cannot be
    written for another reason."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._failure: StageError | None = None

    def write(self, text: str) -> int:
        """Write text, as the stream does."""
        if self._failure is not None and text:
            # a library that only tried whether it can write may have taken the first one
            raise self._failure
        try:
            return self._stream.write(text)
        except OSError as error:
            self._ended(error)
            return len(text)

    def flush(self) -> None:
        """Flush what was written."""
        try:
            self._stream.flush()
        except OSError as error:
            self._ended(error)

    def _ended(self, error: OSError) -> None:
        # what is left in the stream's own buffer would fail once more at the interpreter's end
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)
        if not isinstance(error, BrokenPipeError):
            self._failure = StageError(
                f"what is printed cannot be written ({error.strerror}); send it elsewhere and run "
                "the same command again."
            )
            raise self._failure from error

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def outlast_readers() -> None:
    """Let what this process prints outlast its readers."""
    sys.stdout, sys.stderr = Outlasting(sys.stdout), Outlasting(sys.stderr)
