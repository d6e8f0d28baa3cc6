"""``automap simulate``: a scenario file becomes a drive folder."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

from automap.errors import ConfigError
from automap.io.atomic import make_folder, write_failure


def simulate(
    scenario: Path | str,
    out: Path,
    seed: int | None = None,
    progress: Callable[[float, str], None] = lambda fraction, text: None,
) -> None:
    """Write the drive of a scenario, truth included, to the new folder ``out``.

    ``scenario`` is a file, or the name of one that comes with AutoMap ("sample"). The same
    seed gives the same drive; ``seed`` replaces the scenario's. The folder appears whole or
    not at all. Raises ConfigError for a bad scenario or an existing folder that is not
    empty, StageError when the folder cannot be written.
    """
    from automap.simulation.drive_writer import write_drive
    from automap.simulation.scenario import load_scenario

    description = load_scenario(_scenario_file(scenario))
    out = Path(out)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ConfigError(f"{out} exists already; remove it or choose another folder with -o")
    make_folder(out.parent)
    temporary = out.with_name(f".{out.name}.{os.getpid()}.tmp")
    try:
        temporary.mkdir()
        write_drive(description, temporary, seed, progress)
        if out.exists():
            out.rmdir()
        os.replace(temporary, out)
    except OSError as error:
        raise write_failure(out, error) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _scenario_file(scenario: Path | str) -> Path:
    path = Path(scenario)
    if path.suffix == ".toml" or path.exists():
        return path
    from pipeline.config import configs_dir

    folder = configs_dir() / "scenarios"
    named = folder / f"{scenario}.toml"
    if named.is_file():
        return named
    known = ", ".join(sorted(p.stem for p in folder.glob("*.toml")))
    raise ConfigError(f"there is no scenario '{scenario}'; give a TOML file or one of: {known}")
