"""``automap fleet``: very many drives on one machine or several, and one map of them."""
