"""Signs in images: what they look like, and where they are."""
