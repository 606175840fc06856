"""``python -m diagrams`` is ``quietfix``."""

from diagrams.commands.command_line import main

main()
