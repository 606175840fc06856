"""The compiled unscented filter: sigma points through a measurement, sigma points through a motion.

May import: systems.kernels, systems.kernels.particles.
"""
