"""The packaged systems: each a scenario and what it declares of one."""
