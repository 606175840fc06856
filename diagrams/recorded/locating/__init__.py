"""From differences that were measured to a place: a table, a system that is fed with it, and its run."""
