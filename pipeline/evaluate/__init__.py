"""``automap evaluate``: a run against a truth."""
