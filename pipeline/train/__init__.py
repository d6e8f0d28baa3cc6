"""How the detector and the classifier that come with the package were trained.

Needs the extra ``training`` (PyTorch among others); nothing else in the package imports it.
"""
