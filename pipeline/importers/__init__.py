"""Drive folders from recordings in other forms, ``automap import``: one module per kind."""
