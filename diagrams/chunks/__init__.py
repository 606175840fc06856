"""What a long study is cut into, and the record of its finished chunks, by which a run that was killed goes on.

May import: diagrams.schema.
"""
