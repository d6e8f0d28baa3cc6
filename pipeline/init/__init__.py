"""Look at a folder of recordings and write the manifest that makes it a drive."""
