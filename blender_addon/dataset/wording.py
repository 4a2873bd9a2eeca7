"""What the pipeline says, in the words of the window: labels of the panel instead of options."""

import re

from ..pipeline.dataset.options import OPTIONS

_SENTENCES = (
    (" (--out)", ""),
    ("run the same command again", "press Render Dataset again"),
    ("start the run again", "press Render Dataset again"),
)


def in_window_words(message: str) -> str:
    """A message of the pipeline for the window: ``--engine cycles`` becomes ``Engine Cycles``."""
    for words, own in _SENTENCES:
        message = message.replace(words, own)
    message = re.sub(r"\boptions\.(\w+)", lambda found: _label(found[1]), message)
    # other names, such as "distance", are words as well
    message = re.sub(
        r"\b[a-z]+(?:_[a-z]+)+\b", lambda found: _label(found[0]) if found[0] in OPTIONS else found[0], message
    )
    return re.sub(r"--([a-z][a-z-]*)(?: ([a-z]+)\b)?", _named, message)


def _label(name: str) -> str:
    return OPTIONS[name].label if name in OPTIONS else name.replace("_", " ").title()


def _named(found: re.Match[str]) -> str:
    option, value = found[1].replace("-", "_"), found[2]
    known = option in OPTIONS and value in OPTIONS[option].choices
    return _label(option) + ("" if value is None else f" {value.title() if known else value}")
