"""Where along which road of a road layer a path and its signs lie."""
