"""What recovery asks of every trial at every epoch: predicted innovations, and how surprising they go on to be.

May import: systems.kernels.
"""
