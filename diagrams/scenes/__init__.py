"""Scenes in space: a result that is played in three dimensions, in Drake's Meshcat.

May import: diagrams.assembly, diagrams.console, diagrams.pages, diagrams.quantities, diagrams.schema, diagrams.studies,
diagrams.writers, systems, systems.earth.
"""
