"""From the fields of a system of a user's own to its models and parts."""
