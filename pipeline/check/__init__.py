"""``automap check``: the checks of one kind of file each; ``command`` puts them together."""
