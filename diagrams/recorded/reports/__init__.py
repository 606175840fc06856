"""What a run of a recording tells: tables, notes, figures."""
