"""``python -m quietfix`` is ``quietfix``."""

from quietfix.diagrams.commands.command_line import main

main()
