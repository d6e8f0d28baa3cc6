"""One file a stage; each exports ``STAGE``."""
