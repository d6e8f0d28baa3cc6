"""What must hold after a fault: a code of the contract, one sentence, old files or new ones."""

from __future__ import annotations

import json
import re
import signal
from pathlib import Path

from tests.faults.child import Ended
from tests.faults.commands import undated

_STRANGE = re.compile(r"Traceback|unexpectedly|Warning:|Error:|terminate called|core dumped")
_CODES = {0, 2, 3, 4, 130}
MOST_LINES = 4
"""Of stderr: an error, and the warnings before it."""


def wrong_end(ended: Ended, killed: bool, most_lines: int = MOST_LINES) -> str:
    """What is wrong with how a command ended, or nothing. More than ``MOST_LINES`` are for those
    that tell what happened meanwhile and go on."""
    if ended.hung:
        return "hung"
    text = ended.out + ended.err
    if found := _STRANGE.search(text):
        line = next(line for line in text.splitlines() if found[0] in line)
        return f"says {line.strip()[:200]}"
    if killed and ended.code == -signal.SIGKILL:
        return ""
    if ended.code not in _CODES:
        return f"exit code {ended.code}"
    said = ended.err.strip().splitlines()
    if len(said) > most_lines:
        return f"{len(said)} lines on stderr"
    if most_lines > MOST_LINES:
        return ""
    if ended.code and (not said or not re.match("error: |interrupted;", said[-1])):
        return f"exit code {ended.code} without a sentence: {ended.err.strip()[-100:]!r}"
    return ""


def wrong_files(
    out: Path, old: dict[str, bytes], new: dict[str, bytes], told: frozenset[str], dead: bool
) -> str:
    """A file below OUT that is neither the old one nor the new one whole, or nothing.

    ``dead``: the process had no time to tidy up, and temporary files may be left.
    """
    for path in sorted(out.rglob("*")) if out.is_dir() else ():
        name = str(path.relative_to(out))
        if ".tmp" in name or name.startswith((".merge.", ".tmp")):
            if not dead:
                return f"{name} is left behind"
        elif not path.is_file():
            continue
        elif path.name in told:
            if path.suffix == ".json" and not _is_json(path):
                return f"{name} is half written"
        elif undated(path) not in (old.get(name), new.get(name)):
            return f"{name} is neither the old file nor the new one"
    return ""


def _is_json(path: Path) -> bool:
    try:
        json.loads(path.read_bytes())
    except ValueError:
        return False
    return True


def unsynced(log: str) -> list[str]:
    """Files that got their name before their bytes were safe, from a log of ``shim.log_to()``.

    After a loss of power such a file may be there and empty. A rename is safe where the file was
    synced after its last write, and kept where its folder is synced afterwards.
    """
    dirty: set[str] = set()
    wrong: list[str] = []
    waiting: dict[str, str] = {}
    for line in log.splitlines():
        what, path, other = line.split("\t")
        if what == "w":
            dirty.add(path)
        elif what == "s":
            dirty.discard(path)
            waiting = {name: folder for name, folder in waiting.items() if folder != path}
        elif what == "r":
            if path in dirty:
                dirty.discard(path)
                wrong.append(other)
            if ".tmp" not in other:
                waiting[other] = str(Path(other).parent)
    return wrong + [f"the name of {name}" for name in waiting]
