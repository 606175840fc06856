"""Which satellite was heard: received frequencies against the two-line elements of many.

May import: diagrams.console, diagrams.readers, diagrams.schema, diagrams.statistics, diagrams.studies,
diagrams.writers, systems, systems.earth.
"""
