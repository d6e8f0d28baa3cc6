"""What goes with a release: its bill of materials, and what is known against what is in it."""
