"""The work of ``automap regress``: run, compare, page, store."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from automap.errors import ConfigError
from automap.io.atomic import make_folder, plain, write_json, write_text
from automap.regression.change import Tolerance
from pipeline.regress.baseline import read_baseline, write_baseline
from pipeline.regress.session import WORK_FOLDER, DriveResult, drive_names, run_session
from pipeline.settings.load import Settings

PAGE = "regress.html"
RESULT = "regress.json"
_NAMED = 3


@dataclass(frozen=True)
class Request:
    """What to compare with what; ``work`` None is the folder beside the baseline."""

    drives: Sequence[Path]
    baseline: Path
    work: Path | None
    settings: Settings
    jobs: int = 1
    allowed: Tolerance = field(default_factory=Tolerance)
    new_drives_welcome: bool = False


@dataclass(frozen=True)
class Session:
    """Results of all drives and the page that shows them."""

    results: tuple[DriveResult, ...]
    page: Path

    @property
    def exit_code(self) -> int:
        """The highest of the drives."""
        return max(result.exit_code for result in self.results)

    @property
    def failure_code(self) -> int:
        """The highest of the drives that could not be run."""
        return max(result.exit_code if result.now is None else 0 for result in self.results)

    @property
    def question(self) -> str:
        """What storing would change, in one sentence."""
        runs = [result for result in self.results if result.now is not None]
        new = [result.name for result in runs if result.then is None]
        moved = [result.name for result in runs if result.moved]
        parts = [
            f"{what} of {_some(found)}"
            for what, found in (("first figures", new), ("figures that moved", moved))
            if found
        ]
        return f"This stores {' and '.join(parts) or 'the same figures again'}."


def regress(request: Request, log: Callable[[str], None] = lambda text: None) -> Session:
    """Run the drives, compare them and write the page into the work folder.

    Raises ConfigError, before anything runs, for drives without stored figures unless they are
    welcome, and InputError for a baseline that cannot be read.
    """
    from pipeline.regress.page import page_html

    called = drive_names(request.drives)
    stored = read_baseline(request.baseline)
    new = [name for name in called if name not in stored]
    if new and not request.new_drives_welcome:
        absent = [folder for folder in request.drives if not folder.exists()]
        if absent:
            raise ConfigError(f"{absent[0]}: there is no such drive folder; check the path.")
        raise ConfigError(
            f"{request.baseline} has no figures of {_some(new)}; store them first with "
            "automap regress --update."
        )
    work = make_folder(request.work or request.baseline.parent / WORK_FOLDER)
    results = run_session(
        request.drives, stored, work, request.settings, request.jobs, request.allowed, log
    )
    session = Session(tuple(results), work / PAGE)
    write_json(work / RESULT, as_dict(session))
    write_text(session.page, page_html(results))
    return session


def store(session: Session, request: Request) -> str:
    """Put the new figures into the baseline; those of other drives stay. What was done."""
    stored = read_baseline(request.baseline)
    fresh = {r.name: r.now for r in session.results if r.now is not None}
    failed = [result.name for result in session.results if result.now is None]
    left = f"; {_some(failed)} failed, so what was stored before stays" if failed else ""
    if not fresh:
        return f"nothing stored{left}"
    write_baseline(request.baseline, {**stored, **fresh})
    return f"stored {len(fresh)} drive{'s' if len(fresh) != 1 else ''} in {request.baseline}{left}"


def as_dict(session: Session) -> dict[str, Any]:
    """The session in JSON's types."""
    value = {
        "exit_code": session.exit_code,
        "drives": [
            {
                "name": result.name,
                "verdict": result.verdict,
                "exit_code": result.exit_code,
                "error": result.error or None,
                "out": str(result.out),
                "moved": [change.name for change in result.moved],
                "changes": [vars(change) for change in result.changes],
            }
            for result in session.results
        ],
    }
    return dict(plain(value))


def _some(names: Sequence[str]) -> str:
    shown = ", ".join(names[:_NAMED])
    return shown if len(names) <= _NAMED else f"{shown} and {len(names) - _NAMED} more"
