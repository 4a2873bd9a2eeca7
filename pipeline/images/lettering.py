"""Letters of five by seven pixels, for pictures that are made without a library that draws."""

import numpy as np

_GLYPHS = {
    "A": " ### |#   #|#   #|#####|#   #|#   #|#   #",
    "C": " ### |#   #|#    |#    |#    |#   #| ### ",
    "G": " ### |#   #|#    |# ###|#   #|#   #| ### ",
    "H": "#   #|#   #|#   #|#####|#   #|#   #|#   #",
    "I": " ### |  #  |  #  |  #  |  #  |  #  | ### ",
    "L": "#    |#    |#    |#    |#    |#    |#####",
    "M": "#   #|## ##|# # #|# # #|#   #|#   #|#   #",
    "N": "#   #|##  #|# # #|# # #|#  ##|#   #|#   #",
    "O": " ### |#   #|#   #|#   #|#   #|#   #| ### ",
    "P": "#### |#   #|#   #|#### |#    |#    |#    ",
    "R": "#### |#   #|#   #|#### |# #  |#  # |#   #",
    "S": " ####|#    |#    | ### |    #|    #|#### ",
    "T": "#####|  #  |  #  |  #  |  #  |  #  |  #  ",
    "U": "#   #|#   #|#   #|#   #|#   #|#   #| ### ",
    "X": "#   #|#   #| # # |  #  | # # |#   #|#   #",
    "Y": "#   #|#   #| # # |  #  |  #  |  #  |  #  ",
    "Z": "#####|    #|   # |  #  | #   |#    |#####",
    "m": "     |     |## # |# # #|# # #|# # #|# # #",
    "0": " ### |#   #|#  ##|# # #|##  #|#   #| ### ",
    "1": "  #  | ##  |  #  |  #  |  #  |  #  | ### ",
    "2": " ### |#   #|    #|   # |  #  | #   |#####",
    "3": " ### |#   #|    #|  ## |    #|#   #| ### ",
    "4": "   # |  ## | # # |#  # |#####|   # |   # ",
    "5": "#####|#    |#### |    #|    #|#   #| ### ",
    "6": " ### |#    |#    |#### |#   #|#   #| ### ",
    "7": "#####|    #|   # |  #  |  #  |  #  |  #  ",
    "8": " ### |#   #|#   #| ### |#   #|#   #| ### ",
    "9": " ### |#   #|#   #| ####|    #|    #| ### ",
    ".": "     |     |     |     |     | ##  | ##  ",
    "-": "     |     |     |#####|     |     |     ",
    " ": "     |     |     |     |     |     |     ",
}
"""Rows from the top, separated by ``|``."""


def lettering(text: str, size: int = 1) -> np.ndarray:
    """A line of text as a mask, ``(7 * size, (6 * length - 1) * size)`` bool.

    Parameters
    ----------
    text
        Of the capitals A C G H I L M N O P R S T U X Y Z, ``m``, digits, dot, hyphen and space.
    size
        Side of a dot of the letters, px.
    """
    glyphs = [[[dot == "#" for dot in row + " "] for row in _GLYPHS[letter].split("|")] for letter in text]
    return np.kron(np.concatenate(glyphs, axis=1)[:, :-1], np.ones((size, size), np.bool_))
