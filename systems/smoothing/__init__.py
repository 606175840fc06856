"""Smoothing: what later measurements say of an earlier state; pure functions of what a filter has told.

May import: systems, systems.filters, systems.motion.
"""
