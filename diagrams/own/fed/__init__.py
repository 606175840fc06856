"""A system of a user's own that is fed from a table of measurements, and the table that a study writes."""
