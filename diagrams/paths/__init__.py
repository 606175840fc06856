"""Where things are: movers of a user's file, and the functions of time that they stand for."""
