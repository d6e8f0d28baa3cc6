"""The background that a drive names in its manifest."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from automap.io import names
from automap.io.trust import check_inside

if TYPE_CHECKING:
    from automap.io.drive import Drive


def background_file(drive: Drive, stated: str = "") -> Path | None:
    """The file that the settings name, else the drive's own; ConfigError where that is not the
    drive's to name."""
    own = drive.manifest.site.background
    if stated or not own:
        return Path(stated) if stated else None
    check_inside(drive.path / own, drive.path, f"{drive.path / names.MANIFEST}: site.background")
    return drive.path / own
