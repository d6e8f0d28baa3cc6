"""What the subcommands share: ``--allow-outside``, ``--debug`` and how a failure is shown."""

from __future__ import annotations

import traceback
from pathlib import Path
from typing import Any

import click


class Command(click.Command):
    """A subcommand that also takes ``--allow-outside`` and ``--debug`` after its own name."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.params.append(
            click.Option(
                ["--allow-outside"],
                multiple=True,
                metavar="DIR",
                type=click.Path(path_type=Path),
                expose_value=False,
                callback=_allow,
                help="Let drives name files, or lead by links, into this folder too; repeatable.",
            )
        )
        self.params.append(
            click.Option(
                ["--debug"],
                is_flag=True,
                expose_value=False,
                help="Show the traceback of an error.",
            )
        )


def _allow(context: click.Context, option: click.Parameter, folders: tuple[Path, ...]) -> None:
    """Allow the folders for as long as the command runs."""
    if folders:
        from automap.io.trust import allowing

        context.with_resource(allowing(folders))


def show_failure(error: BaseException, debug: bool) -> None:
    """One sentence on stderr, with the traceback before it on ``debug``."""
    if debug:
        click.echo("".join(traceback.format_exception(error)), err=True)
    from automap.io.limits import MAX_MESSAGE

    text = " ".join(str(error).split())
    if len(text) > MAX_MESSAGE:
        text = f"{text[: MAX_MESSAGE // 2]} ... {text[-MAX_MESSAGE // 2 :]}"
    click.echo(click.style("error: ", fg="red") + text, err=True)


def debug_wanted() -> bool:
    """Whether ``--debug`` stands anywhere on the command line."""
    return bool(click.get_current_context().obj)
