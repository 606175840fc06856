"""The Earth's shape, axes and time: geodetic coordinates, Earth-fixed and inertial axes, time scales.

May import: systems.
"""
