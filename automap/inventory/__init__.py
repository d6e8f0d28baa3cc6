"""A map of signs against a list of signs that somebody keeps."""
