"""One module per section of the configuration.

To add a setting: a field with a default in the section's class here, and the same key
with its unit in ``configs/default.toml``. A test holds the two together.
"""
