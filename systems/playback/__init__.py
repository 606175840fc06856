"""Blocks that play one of several recorded tracks, so that one diagram serves all of them.

May import: systems.
"""
