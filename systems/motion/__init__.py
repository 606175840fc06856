"""Motion: how things move, as pure functions of state and time; nothing here knows Drake.

May import: systems, systems.kernels, systems.trajectories.
"""
