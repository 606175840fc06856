"""What a scenario may say, how it is read and checked, and the one kind of error that a user sees.

May import: systems.
"""
