"""YAML as OpenCV and ROS write it: blocks of keys, lists in brackets, numbers and words.

OpenCV's own parser crashes on files nested deeply, and takes hours for others.
"""

import json
import re

from ..errors import InputError
from ..files.tables import MOST_LEVELS, parsed_json

_WORD = re.compile(r'"[^"]*"|[^\[\]{},:"\s][^\[\]{},:"\n]*')


def opencv_table(text: str, where: str) -> object:
    """The content of a text as dictionaries, lists, numbers and strings.

    Raises
    ------
    InputError
        No such text, or lists and tables more than :data:`.MOST_LEVELS` deep in one another.
    """
    try:
        lines = [line.rstrip() for line in text.expandtabs().splitlines()]
        lines = [line for line in lines if line.strip() and not re.match(r"\s*#|%YAML|---|\.\.\.$", line)]
        return _block([(len(line) - len(line.lstrip()), line.strip()) for line in lines][::-1], 0)
    except (ValueError, InputError) as error:
        raise InputError(f"{where}: expected YAML as OpenCV writes it, cannot read it ({error})") from None


def _block(lines: list[tuple[int, str]], level: int) -> object:
    """The list or table that begins with the last of the lines, which are taken away."""
    if level > MOST_LEVELS or not lines:
        raise ValueError(f"nothing, or more than {MOST_LEVELS} levels")
    indent, is_list = lines[-1][0], lines[-1][1].startswith("-")
    entries: list[tuple[str, object]] = []
    while lines and lines[-1][0] == indent and lines[-1][1].startswith("-") == is_list:
        key, mark, rest = lines.pop()[1].partition("-" if is_list else ":")
        if not mark:
            raise ValueError(f"no colon behind {key[:40]!r}")
        # a type such as !!opencv-matrix says nothing that the keys do not
        rest = re.sub(r"^\s*!\S*", "", rest).strip()
        parts = [rest]
        if not rest and lines and (lines[-1][0] > indent or (not is_list and lines[-1][1].startswith("-"))):
            entries.append((key.strip("\"' "), _block(lines, level + 1)))
            continue
        # a list goes on in lines of any indentation
        left = _open_brackets(rest)
        while lines and (left > 0 or lines[-1][0] > indent):
            parts.append(lines.pop()[1])
            left += _open_brackets(parts[-1])
        entries.append((key.strip("\"' "), _value("\n".join(parts))))
    if lines and (level == 0 or lines[-1][0] > indent):
        raise ValueError(f"an indentation that fits nothing before {lines[-1][1][:40]!r}")
    return [value for _, value in entries] if is_list else dict(entries)


def _open_brackets(text: str) -> int:
    return sum({"[": 1, "{": 1, "]": -1, "}": -1}.get(sign, 0) for sign in re.sub(r'"[^"]*"', "", text))


def _value(text: str) -> object:
    if text.startswith(("[", "{")):
        return parsed_json(_WORD.sub(lambda word: json.dumps(_scalar(word[0])), text), "in brackets")
    return _scalar(text)


def _scalar(text: str) -> object:
    """A number, or a string without its quotes."""
    text = text.strip()
    if re.fullmatch(r"[-+]?\d{1,18}", text):
        return int(text)
    if re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?\.(Inf|Nan)", text):
        return float(re.sub(r"\.(?=[IN])", "", text))
    return text[1:-1] if text[:1] in ("'", '"') and text[-1:] == text[:1] else text
