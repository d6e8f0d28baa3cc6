"""How large what a file holds may be before it is no recording any more."""

from __future__ import annotations

MAX_COLUMNS = 10_000
"""Columns of a table. The widest loggers write some hundred; a header of more is a garbled one."""

MAX_ROW_BYTES = 1 << 20
"""Bytes of a row of a table: a hundred for each of the most columns. A longer one has lost its
line ends."""

SHOWN = 60
"""Characters of a file's own text that a message repeats; a line of a terminal has eighty."""

MAX_NUMBER = 1e12
"""Size of a number that a manifest or a setting may have. In metres, seconds, degrees and per cent
no quantity of a drive comes near it, and its square is far from the largest a computer has."""

MAX_MESSAGE = 2000
"""Characters of a sentence that is told; what is longer repeats a file, and its middle is left
out."""

MAX_UNPACKED_BYTES = 1 << 30
"""Bytes of one table in an archive. Ten hours of a phone's sensor at 500 Hz are as many."""
