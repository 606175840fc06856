"""Geometry that measurement models share: lines of sight, light time, body axes, visibility, refraction.

May import: systems, systems.earth, systems.trajectories.
"""
