"""The command line; ``main`` is what ``automap`` calls."""

from pipeline.cli.root import main

__all__ = ["main"]
