"""What keeps a Gaussian filter with its target: gates that open again, heavy tails, second minima, sustained surprise.

May import: systems, systems.filters, systems.kernels, systems.measurement.
"""
