"""Files that are spoilt, and what a reader may say of them."""

import pytest

from quietfix.diagrams.schema.errors import UserError


def said(read, path, content):
    """Return the one line by which a reader refuses a content."""
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(UserError) as caught:
        read(path)
    message = str(caught.value)
    assert "\n" not in message and len(message) < 500 and path.name in message, message
    return message


def refused_or_read(read, path, content):
    """Return what a reader reads of a content, or None if it refuses it in one line."""
    path.write_bytes(content)
    try:
        return read(path)
    except UserError as error:
        assert "\n" not in str(error) and len(str(error)) < 500 and path.name in str(error), str(error)
        return None
