"""Iterated function systems: genome -> maps -> probabilities -> points, and the geometry of the attractor.

Import from the modules; this file stays empty so that `ifs.genome` can be used without numba.
"""
