"""A segment of openpilot as a drive folder."""

from __future__ import annotations

from pathlib import Path

from automap.errors import InputError

_LOGS = ("rlog", "qlog")


def import_openpilot(source: Path, out: Path) -> list[str]:
    """Write a segment that was converted as comma2k19 is; a bare rlog cannot be read.

    Returns warnings; raises InputError that says how to convert a log.
    """
    from pipeline.importers.comma2k19 import import_comma2k19

    source = Path(source)
    logs = [source] if source.is_file() else sorted(source.glob("*")) if source.is_dir() else []
    named = [path.name for path in logs if path.name.startswith(_LOGS)]
    if named and not (source / "processed_log").is_dir():
        raise InputError(
            f"{source}: {named[0]} is Cap'n Proto with openpilot's own schema, which changes with "
            "its versions and is not part of AutoMap; convert it with openpilot's tools to "
            "processed_log and global_pose, as comma2k19 has them, and import that."
        )
    return import_comma2k19(source, out, kind="openpilot")
