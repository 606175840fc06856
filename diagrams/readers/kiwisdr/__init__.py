"""Recordings of KiwiSDR receivers: which files there are, and where their receivers stand.

May import: diagrams.readers, diagrams.schema, systems, systems.earth, systems.iq.
"""
