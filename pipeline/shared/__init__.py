"""What several commands use: what a run left in OUT, progress on the terminal, care for files."""
