"""The vocabulary of signs: their classes, what a class says of a sign, and how its face looks."""
