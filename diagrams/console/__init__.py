"""What is printed: tables as wide as the terminal, and how far a run is.

May import: systems.kernels.
"""
