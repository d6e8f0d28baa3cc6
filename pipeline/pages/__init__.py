"""The pages that commands write: sections, plots, and the one template that puts them together."""
