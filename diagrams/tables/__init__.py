"""Tables of results, and the notes below them: the same on a terminal and on a page.

May import: diagrams.console, diagrams.statistics, diagrams.studies.
"""
