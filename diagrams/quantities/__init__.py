"""What the components of a state are: names, units, directions, and the frames that they are in.

May import: diagrams.schema, systems.earth, systems.motion.
"""
