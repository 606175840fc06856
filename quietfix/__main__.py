"""``python -m quietfix`` is ``quietfix``."""

from quietfix.diagrams.commands.command_line import main

if __name__ == "__main__":  # and not where a worker process imports it
    main()
