"""Sensor blocks: truth in, measurements out; and recorded measurements in their place.

May import: systems, systems.angles, systems.fixes, systems.geometry, systems.measurement, systems.playback.
"""
