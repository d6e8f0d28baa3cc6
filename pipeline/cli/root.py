"""The ``automap`` command: subcommands loaded when used, failures turned into exit codes."""

from __future__ import annotations

import atexit
import difflib
import importlib
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NoReturn

import click

from automap import __version__
from automap.errors import AutoMapError, ConfigError, of_system
from pipeline.cli.command import show_failure
from pipeline.cli.streams import outlast_readers
from pipeline.shared.interrupts import interruptible, told_to_end, uninterruptible

# small matrices only: a pool of threads costs more than it brings, and numpy starts it at import
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# arrays take what is in them: with huge pages ten hours are half as large again
os.environ.setdefault("NUMPY_MADVISE_HUGEPAGE", "0")

_GROUPS: dict[str, dict[str, str]] = {
    "Set up": {
        "init": "pipeline.cli.init",
        "import": "pipeline.cli.import_drive",
        "record": "pipeline.cli.record",
        "calibrate": "pipeline.cli.calibrate",
    },
    "Run": {
        "run": "pipeline.cli.run",
        "detect": "pipeline.cli.detect",
        "merge": "pipeline.cli.merge",
        "fleet": "pipeline.cli.fleet",
    },
    "Look": {
        "check": "pipeline.cli.check",
        "view": "pipeline.cli.view",
        "evaluate": "pipeline.cli.evaluate",
        "compare": "pipeline.cli.compare",
        "gap": "pipeline.cli.gap",
        "experiment": "pipeline.cli.experiment",
    },
    "Export": {"export": "pipeline.cli.export"},
    "Maintain": {
        "simulate": "pipeline.cli.simulate",
        "regress": "pipeline.cli.regress",
    },
}
"""The commands in the order of a user's work, and the modules they are in."""

_COMMANDS = {name: module for group in _GROUPS.values() for name, module in group.items()}

_RESUMED = frozenset({"run", "gap", "regress", "experiment", "fleet"})
"""They keep the stages that were done."""

_EPILOG = """\b
Example:
  automap check data/sample-drive
  automap run data/sample-drive

\b
Exit codes: 0 done, 2 wrong usage or configuration, 3 bad input data, 4 a
stage failed, 5 a requirement not met, 130 interrupted; with several drives
the highest.
"""


class LazyGroup(click.Group):
    """Imports a subcommand's module when the subcommand is named or listed."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the subcommands, in the order of a user's work."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The subcommand of this name, None when there is none."""
        if cmd_name not in _COMMANDS:
            return None
        command: click.Command = importlib.import_module(_COMMANDS[cmd_name]).command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The subcommands by what they are for; those of no group last."""
        widest = max(map(len, _COMMANDS))
        grouped = {name for group in _GROUPS.values() for name in group}
        rest = [name for name in _COMMANDS if name not in grouped]
        for title, names in (*_GROUPS.items(), ("More", rest)):
            rows = []
            for name in names:
                command = self.get_command(ctx, name)
                if command is not None:
                    limit = formatter.width - 6 - widest
                    rows.append((f"{name:{widest}}", command.get_short_help_str(limit)))
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that is named; a usage error names the nearest where there is none."""
        if args and args[0] not in _COMMANDS and not args[0].startswith("-"):
            near = difflib.get_close_matches(args[0], _COMMANDS, n=1)
            hint = f" Did you mean {near[0]}?" if near else ""
            ctx.fail(f"No such command {args[0]!r}.{hint}")
        return super().resolve_command(ctx, args)


@click.command(
    cls=LazyGroup, epilog=_EPILOG, context_settings={"help_option_names": ["-h", "--help"]}
)
@click.version_option(__version__, prog_name="automap")
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
def cli(debug: bool) -> None:
    """Turn recorded drives (IMU, u-blox log, video) into a map of road signs."""
    from pipeline.shared.kernel_cache import ensure_kernel_cache
    from pipeline.shared.room import ensure_room

    ensure_room()
    ensure_kernel_cache()


def main(args: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and leave the process with the contract's exit code."""
    words = list(sys.argv[1:] if args is None else args)
    code, begun, done = 4, False, False
    # the first that is registered is the last that is called
    atexit.register(lambda: _leave(code))
    try:
        interruptible()
        outlast_readers()
        begun = True
        code = run_command(words)
        done = True
        uninterruptible()
    except KeyboardInterrupt:
        uninterruptible()
        if not begun:
            code = _end_interrupted(words)
        elif not done:
            # another one, while the first was told of
            code = 130
    sys.exit(code)


def _leave(code: int) -> NoReturn:
    """End the process without taking the interpreter down.

    A worker of a compiled library that lets go of an object of Python's at that moment is ended
    inside a destructor, and C++ aborts the process (Arrow's readers of CSV, once in thousands).
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(AutoMapError, OSError, ValueError):
            stream.flush()
    os._exit(code)


def _end_interrupted(words: list[str]) -> int:
    command = next((word for word in words if not word.startswith("-")), "")
    then = "resumes" if command in _RESUMED else "starts over"
    click.echo(f"interrupted; the same command {then}", err=True)
    return 130


def _check_words(words: list[str]) -> None:
    """ConfigError for a name that is not UTF-8: maps, pages and records are, and hold names."""
    here = ""
    with suppress(FileNotFoundError):
        here = os.getcwd()
    for word in (*words, here):
        try:
            word.encode()
        except UnicodeEncodeError as error:
            raise of_system(error) or ConfigError(str(error)) from error


def run_command(words: list[str]) -> int:
    """Run the command line and return the exit code; every failure is told on stderr."""
    # wanted wherever it stands, also when the failure comes before the parsing
    debug = "--debug" in words
    try:
        _check_words(words)
        result: Any = cli.main(words, prog_name="automap", standalone_mode=False, obj=debug)
        sys.stdout.flush()
        return result if isinstance(result, int) else 0
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except (click.Abort, KeyboardInterrupt):
        return _end_interrupted(words)
    except AutoMapError as error:
        show_failure(error, debug)
        return error.exit_code
    except Exception as error:
        if told_to_end.is_set():
            # a compiled module makes an error of its own of an interrupt while it is loaded
            return _end_interrupted(words)
        # of a file that is merely looked for; what is read or written has sentences of its own
        failure = of_system(error)
        if failure is not None:
            failure.__cause__ = error
            show_failure(failure, debug)
            return failure.exit_code
        if debug:
            show_failure(error, debug)
        else:
            click.echo(
                f"error: automap failed unexpectedly ({type(error).__name__}: {error}); run "
                "with --debug for the traceback",
                err=True,
            )
        return 4
