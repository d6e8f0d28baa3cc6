"""Where the configuration lies that comes with AutoMap."""

from __future__ import annotations

from pathlib import Path

from automap.errors import ConfigError


def configs_dir() -> Path:
    """The folder with default.toml, sensors/ and scenarios/: the checkout's or the wheel's.

    Raises ConfigError when neither is there.
    """
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "_configs", package.parent / "configs"):
        if (folder / "default.toml").is_file():
            return folder
    raise ConfigError(
        f"the configuration folder is missing beside {package}; install automap again"
    )
