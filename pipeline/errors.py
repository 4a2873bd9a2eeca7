"""The exceptions that a user is meant to read; every other one is a defect of the program."""


class InputError(ValueError):
    """Something given by the user cannot be used.

    The message is one sentence (or two) that says where, what was expected, what was found and what to do. Scripts
    print it as one line and exit with 2; operators report it.
    """


class RunError(RuntimeError):
    """The surroundings stop a run: a full disk, a folder in use, a renderer that died. Scripts exit with 3.

    What was finished stays; the message says how to go on.
    """
