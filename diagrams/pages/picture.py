"""A block diagram for a page: what a drawing may hold, and nothing that could act."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

__all__ = ["inline_svg"]

_SVG = "{http://www.w3.org/2000/svg}"
_TAGS = {"svg", "g", "title", "polygon", "polyline", "path", "ellipse", "text", "tspan"}
_ATTRIBUTES = {
    *("id", "class", "transform", "viewBox", "width", "height", "points", "d", "cx", "cy", "rx", "ry", "x", "y"),
    *("fill", "stroke", "stroke-width", "stroke-dasharray", "text-anchor", "font-family", "font-size", "font-weight"),
    "font-style",
}
_LARGEST = 1 << 21  # bytes


def inline_svg(path: Path) -> str | None:
    """Return a drawing as part of a page; None where there is none that can be read.

    Parameters
    ----------
    path : Path
        ``diagram.svg`` of a result. It may come from elsewhere: only shapes and text of it are taken.

    Returns
    -------
    str or None
        An ``svg`` element as wide as the page gives it.
    """
    try:
        if path.stat().st_size > _LARGEST:
            return None
        text = path.read_text(encoding="utf-8")
        if "<!ENTITY" in text:
            return None
        root = ElementTree.fromstring(re.sub(r"<!DOCTYPE[^>]*>", "", text))
    except (OSError, UnicodeDecodeError, ElementTree.ParseError):
        return None
    if root.tag != f"{_SVG}svg":
        return None
    _clean(root)
    if "viewBox" not in root.attrib:
        return None
    root.attrib.pop("width", None)
    root.attrib.pop("height", None)
    root.set("id", "diagram-svg")
    ElementTree.register_namespace("", "http://www.w3.org/2000/svg")
    return ElementTree.tostring(root, encoding="unicode")


def _clean(element: ElementTree.Element) -> None:
    """Take away what is no shape and no text, in place."""
    for name, value in list(element.attrib.items()):
        if name not in _ATTRIBUTES or "url(" in value:
            del element.attrib[name]
    for child in list(element):
        if not isinstance(child.tag, str) or child.tag.removeprefix(_SVG) not in _TAGS:
            element.remove(child)
        else:
            _clean(child)
