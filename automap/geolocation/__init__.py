"""From boxes in frames and a trajectory to signs on the map.

``views`` turns boxes into rays in one local frame, ``tracking`` links the boxes of one sign
over the frames, ``landmark`` estimates position and size of a sign from its rays,
``merging`` joins and splits tracks, ``boresight`` estimates what all rays of a camera have
in common, ``signs`` assembles the result, ``locate`` runs it all.
"""
