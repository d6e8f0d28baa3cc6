"""Files in and out: one module per format. The rest of the library sees arrays only."""
