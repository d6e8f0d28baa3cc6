"""From boxes in frames and a trajectory to signs on the map.

``views`` turns boxes into rays in one local frame, ``tracking`` links the boxes of one sign
over the frames, ``landmark`` estimates position and size of a sign from its rays,
``passes`` joins passes, ``boresight`` estimates what all rays of a camera have
in common, ``assembly`` makes the signs, ``locate`` runs it all.
"""
