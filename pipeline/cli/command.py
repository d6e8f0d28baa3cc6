"""What the subcommands share: the ``--debug`` option and how a failure is shown."""

from __future__ import annotations

import traceback
from typing import Any

import click


class Command(click.Command):
    """A subcommand that also takes ``--debug`` after its own name."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.params.append(
            click.Option(
                ["--debug"],
                is_flag=True,
                expose_value=False,
                help="Show the traceback of an error.",
            )
        )


def show_failure(error: BaseException, debug: bool) -> None:
    """One sentence on stderr, with the traceback before it on ``debug``."""
    if debug:
        click.echo("".join(traceback.format_exception(error)), err=True)
    text = " ".join(str(error).split())
    click.echo(click.style("error: ", fg="red") + text, err=True)


def debug_wanted() -> bool:
    """Whether ``--debug`` stands anywhere on the command line."""
    return bool(click.get_current_context().obj)
