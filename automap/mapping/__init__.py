"""One map from the signs of many drives.

A drive's signs share the error of its trajectory, which wanders slowly; between drives the
errors are independent. A sighting is a sign as one drive located it. ``association`` says
which sightings are one sign, ``adjustment`` where it stands and how surely, ``existence``
whether it is there at all, ``identity`` and ``changes`` relate the map to an older one.
"""
