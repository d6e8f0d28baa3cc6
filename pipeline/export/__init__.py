"""``automap export``: the map of a run in every format."""
