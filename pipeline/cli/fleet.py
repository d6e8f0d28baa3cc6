"""``automap fleet``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pipeline.cli.command import Command
from pipeline.cli.options import ANY_PATH, Finite, settings_options

if TYPE_CHECKING:
    from pipeline.fleet.add import Added
    from pipeline.fleet.store import Store

_EPILOG = """\b
Examples:
  automap fleet run town --drives 'drives/*'
  automap fleet merge town
  automap fleet status town --json
"""


@click.group("fleet", epilog=_EPILOG, short_help="Map very many drives, on several machines.")
def command() -> None:
    """Run very many drives, and keep one map of them.

    STORE is a folder, also on a network share, or an address as s3://bucket/town. It holds what is
    done and what waits; whatever is ended, on whichever machine, goes on with the same command.
    """


_QUIET = click.option("--quiet", is_flag=True, help="Print nothing but errors and warnings.")


def _warn(texts: list[str]) -> None:
    for text in texts:
        click.echo(click.style("warning: ", fg="yellow") + text, err=True)


def _added(store: Store, drives: tuple[str, ...], quiet: bool) -> Added:
    from pipeline.fleet.add import add

    if not quiet and not store.digests():
        # a share that is not mounted looks like a place for one
        click.echo(f"{store.place.url} is a new store.")
    added = add(store, drives)
    _warn(added.warnings)
    if not quiet:
        click.echo(
            f"{len(added.new)} drives are new, {len(added.replaced)} have changed, "
            f"{added.known} were there."
        )
    return added


@command.command("add", cls=Command, short_help="Put drives on the list.")
@click.argument("url", metavar="STORE")
@click.argument("drives", nargs=-1, required=True, metavar="DRIVE...")
@_QUIET
def add_command(url: str, drives: tuple[str, ...], quiet: bool) -> None:
    """Put drive folders on the list of STORE, which is made where there is none.

    Nothing is run. A drive whose files have changed takes its own place.
    """
    from pipeline.fleet.add import check_there
    from pipeline.fleet.status import write_status
    from pipeline.fleet.store import Store

    check_there(drives)
    store = Store.at(url, make=True)
    _added(store, drives, quiet)
    write_status(store)


@command.command("run", cls=Command, short_help="Run the drives that wait.")
@click.argument("url", metavar="STORE")
@click.option(
    "--drives", multiple=True, metavar="PATTERN", help="Put these on the list first; repeatable."
)
@click.option(
    "--scheduler", metavar="ADDRESS", help="A scheduler of Dask, as tcp://host:8786, in place of "
    "this machine alone.",
)  # fmt: skip
@click.option(
    "--workers", type=click.IntRange(1, 1024), metavar="N",
    help="Drives at a time on this machine. Default: by its cores and its memory.",
)  # fmt: skip
@click.option(
    "--memory", type=Finite(0.1), default=3.0, show_default=True, metavar="GB",
    help="Memory that a drive may take; one that lacked it gets twice as much.",
)  # fmt: skip
@settings_options(
    config="TOML file with settings, which become the store's: drives done with others wait again.",
    assignment="One setting, likewise.",
)
@click.option(
    "--keep-done", is_flag=True, help="Drives that are done stay as they are, whatever changed."
)
@_QUIET
def run_command(
    url: str,
    drives: tuple[str, ...],
    scheduler: str | None,
    workers: int | None,
    memory: float,
    config: Path | None,
    assignments: tuple[str, ...],
    keep_done: bool,
    quiet: bool,
) -> int:
    """Run the drives of STORE that wait.

    Each is run in a process of its own. What cannot be read for a moment is tried three times; a
    drive that is damaged is put aside and named with the reason. The exit code is then 3.
    """
    from pipeline.fleet.add import check_there
    from pipeline.fleet.orders import keep_done as keep
    from pipeline.fleet.orders import settings_of
    from pipeline.fleet.run import order_for, run
    from pipeline.fleet.status import write_status
    from pipeline.fleet.store import Store
    from pipeline.shared.terminal import progress_bar
    from pipeline.shared.verdicts import doubted

    check_there(drives)
    store = Store.at(url, make=bool(drives))
    if drives:
        _added(store, drives, quiet)
    order = order_for(store, settings_of(store, config, assignments), round(memory * 1e9))
    if keep_done:
        keep(store, order.key)
    try:
        with progress_bar("fleet", not quiet) as progress:
            ran = run(store, order, scheduler, workers, progress, click.echo)
    finally:
        write_status(store)
    for entry in store.entries(ran.doubtful):
        _warn([f"{entry.path}: {told.sentence()}" for told in doubted(entry.done)])
    for text in ran.aside.values():
        click.echo(click.style("put aside: ", fg="red") + text, err=True)
    if ran.away:
        text = next(iter(ran.away.values()))
        _warn([f"drives that wait since they are not there: {len(ran.away)}, the first {text}"])
    if not quiet:
        click.echo(
            f"{len(ran.done)} drives done in {ran.seconds:.0f} s, {len(ran.aside)} put aside."
        )
    return 3 if ran.aside or ran.away else 0


@command.command("merge", cls=Command, short_help="Make one map of the drives that are done.")
@click.argument("url", metavar="STORE")
@click.option(
    "--workers", type=click.IntRange(1, 256), default=1, show_default=True, metavar="N",
    help="Processes.",
)  # fmt: skip
@click.option(
    "--min-existence", type=Finite(0.0, 1.0), default=0.5, show_default=True, metavar="P",
    help="Signs less likely than this to be there are left out.",
)  # fmt: skip
@click.option(
    "--scratch", type=click.Path(path_type=Path, file_okay=False), metavar="DIR",
    help="Of an object store: folder of this machine that keeps what a merge needs again.",
)  # fmt: skip
@click.option(
    "--roads", type=ANY_PATH, metavar="FILE",
    help="Lines of roads, as of automap run: signs get road, chainage and side.",
)  # fmt: skip
@_QUIET
def merge_command(
    url: str,
    workers: int,
    min_existence: float,
    scratch: Path | None,
    roads: Path | None,
    quiet: bool,
) -> None:
    """Make one map of the drives of STORE that are done, and publish it as STORE/map.

    Only where something is new it is merged again. The older map stays until the new one is
    complete, and takes its place in one step.
    """
    from pipeline.fleet.merge import merge
    from pipeline.fleet.status import write_status
    from pipeline.fleet.store import Store
    from pipeline.shared.terminal import progress_bar

    store = Store.at(url)
    with progress_bar("merge", not quiet) as progress:
        made = merge(store, workers, min_existence, scratch, progress, roads)
    write_status(store)
    _warn(made.warnings)
    if quiet:
        return
    if not made.new:
        click.echo(f"map {made.version} is that of all {made.drives} drives already.")
        return
    click.echo(
        f"map {made.version}: {made.signs} signs from {made.sightings} sightings of {made.drives} "
        f"drives in {made.seconds:.1f} s; {made.cells[0]} of {made.cells[2]} cells grouped anew, "
        f"{made.cells[1]} placed."
    )
    if made.comparison is not None:
        kinds = [change.kind for change in made.comparison.changes]
        counted = ", ".join(f"{kinds.count(k)} {k}" for k in ("new", "gone", "class", "moved"))
        click.echo(f"changes: {counted}; {made.comparison.unchanged} as before.")


@command.command("status", cls=Command, short_help="Say where the drives stand.")
@click.argument("url", metavar="STORE")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
@click.option(
    "-o", "--out", type=click.Path(path_type=Path, file_okay=False),
    help="Write status.html, drives.jsonl and automap_fleet.prom into this folder.",
)  # fmt: skip
def status_command(url: str, as_json: bool, out: Path | None) -> None:
    """Say how many drives of STORE are done, wait or were put aside, and why.

    The same stands in STORE/status as a page, as JSON lines and for Prometheus, as of the last
    command.
    """
    from pipeline.fleet.status import status, summary_lines, write_status
    from pipeline.fleet.store import Store

    store = Store.at(url)
    told, drives = status(store)
    if out is not None:
        write_status(store, out)
    if as_json:
        click.echo(json.dumps(told, indent=1, ensure_ascii=False))
    else:
        for line in summary_lines(told, drives):
            click.echo(line)


@command.command("retry", cls=Command, short_help="Let drives that were put aside wait again.")
@click.argument("url", metavar="STORE")
@click.argument("drives", nargs=-1, metavar="[DRIVE]...", type=ANY_PATH)
def retry_command(url: str, drives: tuple[Path, ...]) -> None:
    """Let drives of STORE that were put aside wait again, all or those named.

    DRIVE is a drive's folder or its digest.
    """
    from pipeline.fleet.retry import retry
    from pipeline.fleet.status import write_status
    from pipeline.fleet.store import Store

    store = Store.at(url)
    again = retry(store, [str(drive) for drive in drives])
    write_status(store)
    click.echo(f"{len(again)} drives wait again; automap fleet run {url} runs them.")
