"""The colours of structures of the ear that are recognised by their names, as in the paper's figures."""

import re

_COLOURS = {
    r"chorda": (0.0, 1.0, 0.0),
    r"ossic|malleus|incus|stapes": (0.0, 1.0, 1.0),
    r"facial|\bfn\b|\bcn ?(7|vii)\b|^nerve\b": (1.0, 0.0, 1.0),
}
"""Pattern in the name, words separated by spaces -> sRGB 0..1; the first that matches counts."""

OTHER = (1.0, 1.0, 1.0)


def structure_colour(name: str) -> tuple[float, float, float]:
    """The colour, sRGB 0..1, of a structure with this name: white for a name that is not known."""
    words = re.sub(r"[\W_]+", " ", name.lower())
    return next((colour for pattern, colour in _COLOURS.items() if re.search(pattern, words)), OTHER)
