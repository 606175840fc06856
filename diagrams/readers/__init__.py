"""Files that others made: bearings, Doppler, arrival times, I/Q, flights."""
