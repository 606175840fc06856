"""Satellites that are ahead of, or behind, where their elements say: an error along the track, as a state.

May import: systems.measurement, systems.motion, systems.trajectories.
"""
