"""Mistakes put into the code, to see whether the fast tests notice them."""
