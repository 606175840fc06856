"""Recordings of complex or real samples: SigMF, WAV, and files of nothing but samples.

May import: diagrams.schema, systems, systems.earth, systems.iq.
"""
