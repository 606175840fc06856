"""Measurement models: what a sensor would read, and its Jacobian. Pure NumPy over leading axes."""
