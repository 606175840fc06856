"""Results in an object store, by their URL.

May import: diagrams.chunks, diagrams.schema, diagrams.studies.
"""
