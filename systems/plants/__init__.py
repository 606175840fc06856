"""Plants: the blocks that produce truth.

May import: systems, systems.earth, systems.motion, systems.trajectories.
"""
