"""Runs the stages of one drive: decides which, runs them in order, keeps the record."""

from __future__ import annotations

import logging
import shlex
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from automap.errors import AutoMapError, ConfigError, InputError, StageError, of_system
from automap.io import names
from automap.io.atomic import make_folder, write_json
from pipeline.run.cache import Ingredients, gather, why_run
from pipeline.run.digests import DigestCache
from pipeline.run.execute import execute, remove_leftovers, work_folder
from pipeline.run.log_file import logging_to
from pipeline.run.stage import Stage, StageContext
from pipeline.shared.lock import locked
from pipeline.shared.progress import Outcome, Reporter, StageLine
from pipeline.shared.run_record import merge_stages, new_record, read_record, utc_now
from pipeline.shared.verdicts import KEYS

if TYPE_CHECKING:
    from automap.io.drive import Drive
    from pipeline.settings.load import Settings

LOG_FILE = "automap.log"

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Request:
    """What to do with each drive: ``stages`` in order, of which ``selected`` may run."""

    stages: Sequence[Stage]
    selected: Sequence[str]
    settings: Settings
    force: bool = False
    dry_run: bool = False
    command: Sequence[str] = ()


@dataclass
class _Run:
    """The state of one drive's run."""

    request: Request
    drive: Drive
    out: Path
    record: dict[str, Any]
    digests: DigestCache
    reporter: Reporter
    lines: list[StageLine] = field(default_factory=list)
    ran: list[str] = field(default_factory=list)

    def save(self) -> None:
        merge_stages(self.record)
        write_json(self.out / names.RUN, self.record)

    def close(self, started: float) -> None:
        self.record.update(finished=utc_now(), seconds=round(time.perf_counter() - started, 3))
        self.save()
        self.digests.save()

    def finish(self, line: StageLine) -> None:
        self.lines.append(line)
        self.reporter.stage_finished(line)


def run_drive(path: Path, out: Path, request: Request, reporter: Reporter | None = None) -> Outcome:
    """Run the stages of the drive folder ``path`` that are not up to date in ``out``.

    Every failure becomes the outcome's ``error`` and ``exit_code``; only KeyboardInterrupt
    leaves, after the record has been brought up to date.
    """
    reporter = reporter or Reporter()
    reporter.drive_started(path, out)
    run: _Run | None = None
    error: AutoMapError | None = None
    try:
        with _prepared(path, out, request, reporter) as run:
            _check_selection(run)
            _run_stages(run)
            _check_outputs(run)
    except AutoMapError as failure:
        error = failure
    except Exception as failure:
        error = of_system(failure) or StageError(
            f"{path}: the run failed unexpectedly ({type(failure).__name__}: {failure}); run "
            "with --debug for the traceback"
        )
        error.__cause__ = failure
    outcome = Outcome(
        drive=path,
        name=run.drive.name if run else path.resolve().name,
        out=out,
        exit_code=error.exit_code if error else 0,
        error=error,
        stages=tuple(run.lines) if run else (),
        record=run.record if run else {},
    )
    reporter.drive_finished(outcome)
    return outcome


@contextmanager
def _prepared(path: Path, out: Path, request: Request, reporter: Reporter) -> Iterator[_Run]:
    from automap.io.drive import load_drive

    drive = load_drive(path)
    if request.dry_run:
        yield _Run(request, drive, out, read_record(out), DigestCache(out), reporter)
        return
    make_folder(out)
    with locked(out), logging_to(out / LOG_FILE):
        earlier = read_record(out)
        remove_leftovers(out, tuple(stage.name for stage in request.stages))
        record = new_record(path, drive.name, shlex.join(request.command), request.settings.echo())
        record["stages"] = {
            name: {**stage, "ran": False} for name, stage in earlier.get("stages", {}).items()
        }
        log.info("%s with automap %s, Python %s, %s", *_head(record))
        run = _Run(request, drive, out, record, DigestCache(out), reporter)
        started = time.perf_counter()
        try:
            yield run
        except BaseException as failure:
            record["status"] = "interrupted"
            if isinstance(failure, Exception):
                log.error("%s", failure, exc_info=not isinstance(failure, AutoMapError))
                record.update(status="failed", error=str(failure))
            # what ended the run matters more to the user than a record that cannot be written
            with suppress(AutoMapError):
                run.close(started)
            raise
        record["status"] = "done"
        run.close(started)
        log.info("done after %.3f s", record["seconds"])


def _head(record: dict[str, Any]) -> tuple[str, ...]:
    """What ran with what, for the first line of a run in the log."""
    command = record["command"] or f"a run of {record['drive']['path']}"
    return str(command), *(str(record[key]) for key in ("automap", "python", "platform"))


def _check_selection(run: _Run) -> None:
    done = {
        name
        for name, stage in run.record.get("stages", {}).items()
        if stage.get("status") == "done"
    }
    producers = _producers(run.request.stages)
    available = done | set(run.request.selected)
    for stage in run.request.stages:
        if stage.name not in run.request.selected:
            continue
        for need in stage.needs:
            producer = producers.get(need, stage.name)
            if producer not in available:
                raise ConfigError(
                    f"stage {stage.name} needs {need} from stage {producer}, which has not run "
                    f"in {run.out}; leave out --only and --from, or start with --from {producer}"
                )


def _run_stages(run: _Run) -> None:
    producers = _producers(run.request.stages)
    records: list[dict[str, Any]] = []
    for stage in run.request.stages:
        before = run.record.get("stages", {}).get(stage.name)
        selected = stage.name in run.request.selected
        stale = _is_used(stage, run.request) or _cascade(stage, run.ran, producers)
        if not selected and (before is None or not stale):
            # what it would use, as the video, need not be read
            records.append(before or {})
            continue
        now = _gather(run, stage, records)
        reason = why_run(now, before, run.out, run.digests, producers, run.ran)
        if run.request.dry_run:
            reason = _cascade(stage, run.ran, producers) or reason
        if not selected:
            if reason is not None:
                run.reporter.note(f"stage {stage.name} is out of date, but not selected: {reason}")
        elif reason is None and not run.request.force:
            kept = before or {}
            warnings = tuple(kept.get("warnings", ()))
            run.finish(StageLine(stage.name, "kept", "", None, kept.get("result", ""), warnings))
        elif run.request.dry_run:
            run.finish(StageLine(stage.name, "would run", reason or "--force"))
            run.ran.append(stage.name)
        else:
            _run_stage(run, stage, now, reason or "--force")
            run.ran.append(stage.name)
        records.append(run.record.get("stages", {}).get(stage.name, {}))


def _check_outputs(run: _Run) -> None:
    """StageError where files of this run are gone at its end: someone else removed them."""
    if run.request.dry_run:
        return
    stages = (run.record["stages"].get(line.name, {}) for line in run.lines)
    written = (name for stage in stages for name in stage.get("outputs", {}))
    gone = [name for name in written if not (run.out / name).is_file()]
    if gone:
        others = f" and {len(gone) - 1} more" if len(gone) > 1 else ""
        raise StageError(
            f"{run.out / gone[0]}{others} was removed while the run went on; run the command again"
        )


def _run_stage(run: _Run, stage: Stage, now: Ingredients, reason: str) -> None:
    started = time.perf_counter()
    context = StageContext(
        drive=run.drive,
        out=run.out,
        work=work_folder(run.out, stage.name),
        settings=run.request.settings,
        progress=lambda fraction, text: run.reporter.stage_progress(stage.name, fraction, text),
    )
    record: dict[str, Any] = {
        "status": "running",
        "ran": True,
        "reason": reason,
        "started": utc_now(),
        **now.as_json(),
    }
    run.record["stages"][stage.name] = record
    run.save()
    run.reporter.stage_started(stage.name, reason)
    log.info("stage %s: %s", stage.name, reason)

    def close(state: str) -> StageLine:
        seconds = time.perf_counter() - started
        record.update(
            status="done" if state == "ran" else state,
            seconds=round(seconds, 3),
            result=context.result or (_brief(context.metrics) if state == "ran" else ""),
            warnings=list(context.warnings),
            metrics=dict(context.metrics),
        )
        for key in KEYS.values():
            if getattr(context, key) is not None:
                record[key] = getattr(context, key)
        for text in context.warnings:
            log.warning("stage %s: %s", stage.name, text)
        log.info("stage %s %s after %.3f s: %s", stage.name, state, seconds, record["result"])
        return StageLine(
            stage.name,
            state,  # type: ignore[arg-type]
            reason,
            seconds,
            record["result"],
            tuple(context.warnings),
        )

    try:
        written = execute(stage, context)
        record["outputs"] = {
            name: {
                "sha256": run.digests.digest(run.out / name),
                "bytes": (run.out / name).stat().st_size,
            }
            for name in written
        }
        record["key"] = now.key(stage.name)
    except AutoMapError as failure:
        record["error"] = str(failure)
        run.finish(close("failed"))
        raise
    except BaseException:
        run.finish(close("interrupted"))
        raise
    run.finish(close("ran"))
    run.save()


def _brief(metrics: dict[str, Any]) -> str:
    """The first figures of a stage that has put no result into words."""
    figures = [(k, v) for k, v in metrics.items() if isinstance(v, int | float)]
    return ", ".join(f"{key} {value:.4g}" for key, value in figures[:3])


def _gather(run: _Run, stage: Stage, earlier: Sequence[dict[str, Any]]) -> Ingredients:
    try:
        return gather(stage, run.drive, run.out, run.request.settings, run.digests, earlier)
    except OSError as error:
        in_out = Path(error.filename or run.out).is_relative_to(run.out)
        kind = StageError if in_out else InputError
        raise kind(
            f"{error.filename}: cannot be read ({error.strerror}); check the file and its rights"
        ) from error


def _cascade(stage: Stage, ran: Sequence[str], producers: dict[str, str]) -> str | None:
    if names.RUN in stage.needs and ran:
        return f"stage {ran[-1]} would run again"
    sources = [name for name in ran if name in {producers.get(need) for need in stage.needs}]
    return f"stage {sources[-1]} would run again" if sources else None


def _producers(stages: Sequence[Stage]) -> dict[str, str]:
    return {output: stage.name for stage in stages for output in stage.outputs}


def _is_used(stage: Stage, request: Request) -> bool:
    needed = {n for s in request.stages if s.name in request.selected for n in s.needs}
    return any(output in needed for output in stage.outputs)
