"""Drives made by calculation: trajectory, sensors and a rendered video, with their truth."""
