"""What may stand in the file of a system of a user's own."""
