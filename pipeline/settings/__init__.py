"""One module per section of the configuration.

A setting stands once: a field with its type, limits, default and comment, in the section's class
here or, for the fusion, in ``automap.fusion.options``. ``python -m pipeline.settings.defaults``
then writes ``configs/default.toml``; a test sees to it that this was done.
"""
