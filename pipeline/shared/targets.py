"""What a named output file must not replace: recordings, and other results of a run."""

from __future__ import annotations

from pathlib import Path

from automap.errors import AutoMapError, ConfigError
from automap.io import names


def spare_recordings(target: Path, *sources: Path) -> None:
    """ConfigError when writing ``target`` would replace one of ``sources`` or a file that the
    drive around it was recorded in.

    A table of detections may be replaced: commands write it.
    """
    if not target.is_file():
        return
    if any(_same(target, source) for source in sources):
        raise ConfigError(f"{target} is what is to be read; name another file to write.")
    for folder in list(target.resolve().parents)[:2]:
        if (folder / names.MANIFEST).is_file() and _recorded(target, folder):
            raise ConfigError(
                f"{target} is a recording of the drive {folder}, which nothing brings back; name "
                "another file to write."
            )


def spare_results(target: Path, out: Path, own: str) -> None:
    """ConfigError when ``target`` is a result in OUT that is not called ``own``."""
    inside = target.resolve().parent == out.resolve()
    if inside and target.name != own and target.name in names.RUN_FILES:
        raise ConfigError(
            f"{target} is a result of the run in another form; name another file to write."
        )


def _recorded(target: Path, folder: Path) -> bool:
    from automap.io.drive import load_drive

    try:
        drive = load_drive(folder)
    except AutoMapError:
        return _same(target, folder / names.MANIFEST)
    made = [video.detections for video in drive.videos.values() if video.detections is not None]
    truth = [] if drive.truth_dir is None else list(drive.truth_dir.iterdir())
    kept = [path for path in drive.input_files() if path not in made] + truth
    return any(_same(target, path) for path in kept)


def _same(one: Path, other: Path) -> bool:
    return other.exists() and one.exists() and one.samefile(other)
