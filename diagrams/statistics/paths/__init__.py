"""Bounds of what is known of an earlier state by later measurements, or of a state by measurements that come late.

May import: diagrams.quantities, systems.smoothing.
"""
