"""The named effects, family by family: every module is a part of the catalogue."""
