"""Motions of targets that turn or accelerate, for filters of several models.

May import: systems.motion.
"""
