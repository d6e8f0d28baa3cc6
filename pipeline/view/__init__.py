"""``automap view``: the local page, what it shows, and the server that guards it."""
