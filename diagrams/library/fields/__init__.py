"""What the scenarios of the packaged systems say.

May import: diagrams.parts, systems, systems.estimators, systems.options.
"""
