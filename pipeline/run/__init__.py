"""``automap run``: the stages of a drive, which of them must run, and the record of it."""
