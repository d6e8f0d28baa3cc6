"""The failures a user can meet, each with the exit code that the command returns."""

from __future__ import annotations

import errno

_SHOWN = 120  # characters of a name in a sentence
_LONGEST = 1000  # characters of a sentence: ten lines of a terminal


class AutoMapError(Exception):
    """Base of all expected failures. The text is one clear sentence for the user.

    It names the file (and line or byte), what is wrong, and what to do about it. What a file or
    a library puts into it is taken into one line, and the middle of a long one is left out.
    """

    exit_code = 4

    def __init__(self, text: object = "") -> None:
        line = " ".join(str(text).split("\n")).strip() if "\n" in str(text) else str(text)
        if len(line) > _LONGEST:
            line = f"{line[: _LONGEST // 2]} ... {line[-_LONGEST // 2 + 5 :]}"
        super().__init__(line)


class ConfigError(AutoMapError):
    """Wrong usage or configuration."""

    exit_code = 2


class InputError(AutoMapError):
    """Bad input data: the file cannot be used as it is."""

    exit_code = 3


class StageError(AutoMapError):
    """A stage failed although its input was acceptable."""

    exit_code = 4


def of_system(error: BaseException) -> AutoMapError | None:
    """The sentence for what the system refused: a file, a name, memory; None for other failures."""
    if isinstance(error, PermissionError):
        return closed(error)
    no_room = isinstance(error, ImportError) and "failed to map segment" in str(error)
    if isinstance(error, MemoryError) or no_room:
        return StageError("the memory is used up; close other programs or take shorter drives.")
    if isinstance(error, UnicodeEncodeError):
        # names that are no text are text with halves of characters in Python
        words = error.object[: error.start].split(" ")[-1] + error.object[error.start :]
        name = words.split(" ")[0].encode("utf-8", "backslashreplace").decode()
        return ConfigError(f"{_short(name)}: a name of a file or folder is not UTF-8; rename it.")
    if isinstance(error, RuntimeError) and "Symlink loop" in str(error):
        return ConfigError(f"{str(error).partition('from ')[2]} leads to itself by links.")
    if not isinstance(error, OSError):
        return None
    where = str(error.filename or "a file")
    if error.errno in (errno.ENAMETOOLONG, errno.ELOOP):
        return ConfigError(f"{_short(where)}: {error.strerror}; give another name.")
    return StageError(
        f"{_short(where)}: {error.strerror or error}; check the disk or the network share and run "
        "the same command again."
    )


def _short(text: str) -> str:
    """The ends of a long name."""
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN // 2]}...{text[-_SHOWN // 2 :]}"


def closed(error: PermissionError) -> InputError:
    """The sentence for a file or folder that this user may not look into."""
    where = error.filename if isinstance(error.filename, str) else "a file"
    return InputError(f"{where} cannot be looked at ({error.strerror}); check its folder's rights.")


class RegressionError(AutoMapError):
    """A figure, or the verdict on a path, fell short of what was required."""

    exit_code = 5
