"""``python -m diagrams`` is ``quietfix``."""

from diagrams.command_line import main

main()
