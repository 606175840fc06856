"""Complex baseband samples: what they are, how they are made and how they travel.

May import: systems, systems.earth.
"""
