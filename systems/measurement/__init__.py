"""Measurement models: what a sensor would read, and its Jacobian, over leading axes; the equations are kernels.

May import: systems, systems.geometry, systems.kernels, systems.trajectories.
"""
