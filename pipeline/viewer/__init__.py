"""The local page of ``automap view``: what it shows, and the server that guards it."""
