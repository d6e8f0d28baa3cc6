"""``automap detect``, and the search for signs that the detect stage shares with it."""
