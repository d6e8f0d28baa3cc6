"""Paths on the command line."""

from __future__ import annotations

from pathlib import Path

import click

ANY_PATH = click.Path(path_type=Path, readable=False)
"""A path of any kind. Whether it can be read is found by the reader: it says what to do, and one
drive of several that cannot be read does not stop the others."""
