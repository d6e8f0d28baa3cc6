"""Host clock to GPS time by arrival, declaration or motions; velocities against positions."""
