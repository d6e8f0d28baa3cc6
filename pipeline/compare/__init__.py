"""``automap compare``: a map against an inventory of signs."""
