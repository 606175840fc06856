"""What the air and the ionosphere add to ranges, delays and Doppler shifts. Pure NumPy over leading axes.

May import: systems, systems.measurement.
"""
