"""The checks of one kind of file each; ``pipeline.check`` puts them together."""
