"""The log of a run."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from automap.io.atomic import write_failure
from automap.io.trust import check_inside


class _LogFile(logging.FileHandler):
    """A log file that lets the run go on when the disk is full."""

    def handleError(self, record: logging.LogRecord) -> None:
        """Pass over a line that cannot be written; the run itself says what is wrong."""

    def close(self) -> None:
        """Close the file, whether or not its last lines can be written."""
        with suppress(OSError):
            super().close()


@contextmanager
def logging_to(path: Path) -> Iterator[None]:
    """Append what the application and the library log, warnings included, to the file.

    Raises ConfigError where it is a link to a file elsewhere.
    """
    check_inside(path, path.parent, str(path.parent))
    try:
        handler = _LogFile(path, encoding="utf-8")
    except OSError as error:
        raise write_failure(path, error) from error
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    loggers = [logging.getLogger(name) for name in ("automap", "pipeline", "py.warnings")]
    levels = [logger.level for logger in loggers]
    logging.captureWarnings(True)
    for logger in loggers:
        logger.setLevel(logging.INFO)
        logger.addHandler(handler)
    try:
        yield
    finally:
        logging.captureWarnings(False)
        for logger, level in zip(loggers, levels, strict=True):
            logger.removeHandler(handler)
            logger.setLevel(level)
        handler.close()
