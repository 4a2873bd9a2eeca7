"""The exceptions whose messages are for the user; any other exception is a defect of the program."""

from collections.abc import Iterator
from contextlib import contextmanager

LONGEST_MESSAGE = 1200
"""Characters; what was found in a file may be as long as the file."""


class InputError(ValueError):
    """The user's input cannot be used.

    The message says in one or two sentences where, what was expected, what was found and what to do; the middle of a
    very long one is left out. Scripts print it as one line and exit with code 2; operators report it.
    """

    def __init__(self, message: object = "") -> None:
        text = str(message)
        if len(text) > LONGEST_MESSAGE:
            text = f"{text[: LONGEST_MESSAGE // 2]} ... {text[-LONGEST_MESSAGE // 3 :]}"
        super().__init__(printable(text))


class RunError(RuntimeError):
    """The environment stops a run: a full disk, a folder in use, a renderer that crashed.

    Finished results are kept; the message says how to continue. Scripts exit with code 3.
    """

    def __init__(self, message: object = "") -> None:
        super().__init__(printable(str(message)))


def printable(text: str, *, kept: str = "\n") -> str:
    """A text that shows what it holds: names of files can hold escapes, marks that turn words round, broken UTF-8."""
    return "".join(
        character
        if character.isprintable() or character in kept
        else character.encode("unicode_escape", "surrogatepass").decode()
        for character in text
    )


@contextmanager
def naming(name: str) -> Iterator[None]:
    """Let the messages of errors inside the block begin with the one of several things that they are about."""
    try:
        yield
    except (InputError, RunError) as error:
        raise type(error)(f"{name}: {error}") from None
