"""The failures a user can meet, each with the exit code that the command returns."""

from __future__ import annotations


class AutoMapError(Exception):
    """Base of all expected failures. The text is one clear sentence for the user.

    It names the file (and line or byte), what is wrong, and what to do about it.
    """

    exit_code = 4


class ConfigError(AutoMapError):
    """Wrong usage or configuration."""

    exit_code = 2


class InputError(AutoMapError):
    """Bad input data: the file cannot be used as it is."""

    exit_code = 3


class StageError(AutoMapError):
    """A stage failed although its input was acceptable."""

    exit_code = 4


def closed(error: PermissionError) -> InputError:
    """The sentence for a file or folder that this user may not look into."""
    where = error.filename if isinstance(error.filename, str) else "a file"
    return InputError(f"{where} cannot be looked at ({error.strerror}); check its folder's rights.")


class RegressionError(AutoMapError):
    """A figure, or the verdict on a path, fell short of what was required."""

    exit_code = 5
