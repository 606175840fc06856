"""What the files of ``quietfix play`` are known by, so that no other file is replaced."""

__all__ = ["CZML_SIGNATURE", "SIGNATURE"]

SIGNATURE = '<meta name="generator" content="Quietfix play">'
"""In the head of a page."""

CZML_SIGNATURE = "written by Quietfix play"
"""At the beginning of the description of a CZML document."""
