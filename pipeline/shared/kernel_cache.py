"""A place for compiled kernels, so that only the first run waits for the compiler."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path


def ensure_kernel_cache() -> None:
    """Point numba to a folder it can write when it would not find one itself.

    Numba keeps compiled code beside the source, or else below the user's cache folder; when
    neither can be written (a package owned by root, a home that is read-only) it refuses to
    compile. Then a private folder among the temporary files serves.
    """
    if os.environ.get("NUMBA_CACHE_DIR"):
        return
    package = Path(__file__).resolve().parents[2] / "automap"
    if _writable(package) or _writable(_user_cache()):
        return
    folder = Path(tempfile.gettempdir()) / f"automap-kernels-{os.getuid()}"
    if not _private(folder):
        # somebody else's folder of that name: compiled code must not come from there
        folder = Path(tempfile.mkdtemp(prefix="automap-kernels-"))
    os.environ["NUMBA_CACHE_DIR"] = str(folder)


def _user_cache() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())


def _writable(folder: Path) -> bool:
    try:
        while not folder.exists() and folder != folder.parent:
            folder = folder.parent
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _private(folder: Path) -> bool:
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        status = folder.lstat()
    except OSError:
        return False
    owned = status.st_uid == os.getuid() and stat.S_ISDIR(status.st_mode)
    return owned and stat.S_IMODE(status.st_mode) & 0o077 == 0
