"""``automap simulate``: a scenario file becomes a drive folder."""

from __future__ import annotations

import os
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from automap.errors import ConfigError, InputError
from automap.io.atomic import make_folder, write_failure
from pipeline.shared.progress import Progress

if TYPE_CHECKING:
    from automap.simulation.scenario import Scenario
    from pipeline.settings.load import Settings

CAMERA = "front"
"""The name of a scenario's camera in its manifest."""
_DAMAGE = (
    *(ValueError, KeyError, IndexError, TypeError, AttributeError, OverflowError, struct.error),
)
"""What results that are not what they should be can end in."""


def simulate(
    scenario: Path | str,
    out: Path,
    seed: int | None = None,
    progress: Progress = lambda fraction, text: None,
    config: Path | None = None,
    receiver: str = "",
    replay: Path | None = None,
) -> list[str]:
    """Write the drive of a scenario, truth included, to the new folder ``out``.

    ``scenario`` is a file, or the name of one that comes with AutoMap ("sample"). The same
    seed gives the same drive; ``seed`` replaces the scenario's. The sensors have the errors that
    the model ``config`` knows besides the scenario's, and the scenario may use its effects.
    ``receiver`` is one of ``configs/receivers`` in place of the scenario's, ``replay`` a drive with
    truth or a table whose receiver errors take the place of drawn ones. The folder appears whole or
    not at all. Returns what there is to say of the replay. Raises ConfigError for a bad scenario or
    an existing folder that is not empty, InputError for errors that cannot be replayed, StageError
    when the folder cannot be written.
    """
    from pipeline.settings.load import load_settings
    from pipeline.settings.user_effects import activate
    from pipeline.simulate.drive_writer import write_drive

    settings = load_settings(config)
    activate(settings.effects)
    description = load_scenario(_scenario_file(scenario), receiver, replay)
    if config is not None:
        errors = {**description.errors, **_errors_of(settings, description)}
        description = description.model_copy(update={"errors": errors})
    notes: list[str] = []
    _write(out, lambda folder: notes.extend(write_drive(description, folder, seed, progress)))
    return notes


def load_scenario(path: Path, receiver: str = "", replay: Path | None = None) -> Scenario:
    """Read and check a scenario file; ``receiver`` and ``replay`` take the place of its own.

    Errors to be replayed lie where the scenario says, seen from its folder. A receiver of which it
    does not say how far the geoid is from the ellipsoid tells what ``automap check`` expects there.

    Raises ConfigError naming the file, the key and, for an unknown key, the nearest one.
    """
    from automap.io.toml_file import read_toml
    from automap.simulation.scenario import Replay, parse_scenario
    from pipeline.simulate.receivers import with_receiver

    content = read_toml(path, "scenario file")
    scenario = parse_scenario(with_receiver(content, path.parent, receiver), path)
    scenario = _on_its_geoid(scenario)
    setup = scenario.gnss
    if replay is not None:
        if setup is None:
            raise ConfigError(f"{path} has no receiver to replay errors on; add a [gnss] section")
        own = setup.replay.model_dump() if setup.replay is not None else {}
        given = Replay(**{**own, "errors": str(replay)})
    elif setup is None or setup.replay is None:
        return scenario
    else:
        errors = path.parent / Path(setup.replay.errors).expanduser()
        given = setup.replay.model_copy(update={"errors": str(errors)})
    return scenario.model_copy(update={"gnss": setup.model_copy(update={"replay": given})})


def _on_its_geoid(scenario: Scenario) -> Scenario:
    from automap.geoid import geoid_height

    setup, start = scenario.gnss, scenario.start
    if setup is None or "geoid_separation_m" in setup.model_fields_set:
        return scenario
    height = round(geoid_height(start.lat_deg, start.lon_deg), 1)
    setup = setup.model_copy(update={"geoid_separation_m": height})
    return scenario.model_copy(update={"gnss": setup})


def _errors_of(settings: Settings, scenario: Scenario) -> dict[str, dict[str, float] | bool]:
    """What a model says of the sensors, as the errors of a scenario."""
    model = settings.fuse.options()
    errors: dict[str, dict[str, float] | bool] = {e: dict(v) for e, v in model.fixed.items()}
    arm = errors.get("gnss_lever_arm")
    if isinstance(arm, dict) and scenario.gnss is not None:
        # a model has the whole lever, a scenario the error of the stated one
        stated = dict(zip("xyz", scenario.gnss.lever_arm_m, strict=True))
        errors["gnss_lever_arm"] = {p: arm.get(p, 0.0) - stated[p] for p in "xyz"}
    if not model.earth_rotation:
        errors["earth_rotation"] = False
    for effect, values in settings.geolocate.fixed.get(CAMERA, {}).items():
        errors[effect] = dict(values)
    return errors


def simulate_like(run: Path, out: Path, seed: int = 1, config: Path | None = None) -> None:
    """Write the twin of a recorded drive, truth included, to the new folder ``out``.

    ``run`` is the output folder of a finished run of a drive with an IMU: the twin follows its
    smoothed trajectory with the errors and the noise that were fitted. Python files of effects that
    it names are run where the settings ``config`` name them too. Raises InputError
    for another folder, ConfigError for an ``out`` that is not empty, StageError when it cannot
    be written.
    """
    from pipeline.settings.load import load_settings
    from pipeline.simulate.twin import write_twin

    trusted = load_settings(config).effects.paths()

    def fill(folder: Path) -> None:
        try:
            write_twin(Path(run), folder, seed, trusted=trusted)
        except _DAMAGE as error:
            raise InputError(
                f"{run}: its results are damaged or incomplete ({type(error).__name__}: {error}); "
                "run the drive again with --force."
            ) from error

    _write(out, fill)


def _write(out: Path, fill: Callable[[Path], None]) -> None:
    """Fill a new folder that appears whole or not at all."""
    out = Path(out)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ConfigError(f"{out} exists already; remove it or choose another folder with -o")
    make_folder(out.parent)
    temporary = out.with_name(f".{out.name}.{os.getpid()}.tmp")
    try:
        temporary.mkdir()
        fill(temporary)
        if out.exists():
            out.rmdir()
        os.replace(temporary, out)
    except OSError as error:
        raise write_failure(out, error) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _scenario_file(scenario: Path | str) -> Path:
    path = Path(scenario)
    if path.suffix == ".toml" or path.is_file():
        return path
    from pipeline.shared.configs import configs_dir

    folder = configs_dir() / "scenarios"
    named = folder / f"{scenario}.toml"
    if named.is_file():
        return named
    known = ", ".join(sorted(p.stem for p in folder.glob("*.toml")))
    raise ConfigError(f"there is no scenario '{scenario}'; give a TOML file or one of: {known}")
