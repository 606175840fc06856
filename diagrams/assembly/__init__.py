"""How a system is declared and built: signals by name, parts that put blocks there, one builder for every system."""
