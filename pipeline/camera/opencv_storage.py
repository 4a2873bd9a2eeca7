"""YAML and XML as OpenCV writes them, read by OpenCV's own parser in a process of its own.

The parser crashes on deeply nested files and takes hours for others.
"""

import json
from typing import Any

from ..errors import InputError
from ..files.child_process import ChildError, called_apart
from ..files.tables import parsed_json

MOST_ENTRIES = 4096
"""Of a list or table; longer ones are left out. OpenCV takes a time that grows with the square of their number."""

CPU_SECONDS = 2.0


def opencv_table(text: str, where: str) -> object:
    """The content of a text in OpenCV's YAML or XML as dictionaries, lists, numbers and strings.

    Raises
    ------
    InputError
        No such text; or the parser crashes, or takes too long.
    """
    try:
        content = called_apart(json_from_opencv, text.encode(errors="replace"), cpu_seconds=CPU_SECONDS)
    except (InputError, ChildError) as error:
        raise InputError(f"{where}: expected YAML or XML as OpenCV writes it, cannot read it ({error})") from None
    return parsed_json(content, where)


def json_from_opencv(data: bytes) -> bytes:
    """A file of OpenCV as JSON.

    Raises
    ------
    InputError
        OpenCV's reason why it cannot be read.
    """
    # in the child only: Blender need not load it
    import cv2

    try:
        file = cv2.FileStorage(data.decode(), cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        return json.dumps(_content(file.root())).encode()
    except (cv2.error, SystemError) as error:
        raise InputError(str(error.__cause__ or error).strip().splitlines()[-1]) from None
    except (RecursionError, MemoryError, ValueError):
        raise InputError("it is nested too deeply or too large") from None


def _content(node: Any) -> object:
    if node.size() > MOST_ENTRIES:
        return None
    if node.isMap():
        return {key: _content(node.getNode(key)) for key in node.keys()}  # noqa: SIM118 - no dictionary
    if node.isSeq():
        return [_content(node.at(index)) for index in range(node.size())]
    return node.real() if node.isInt() or node.isReal() else node.string() if node.isString() else None
