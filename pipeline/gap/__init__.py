"""``automap gap``: what is missing between the model and recorded drives."""
