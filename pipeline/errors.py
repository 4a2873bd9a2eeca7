"""The exceptions whose messages are for the user; any other exception is a defect of the program."""


class InputError(ValueError):
    """The user's input cannot be used.

    The message says in one or two sentences where, what was expected, what was found and what to do. Scripts print it
    as one line and exit with code 2; operators report it.
    """


class RunError(RuntimeError):
    """The environment stops a run: a full disk, a folder in use, a renderer that crashed.

    Finished results are kept; the message says how to continue. Scripts exit with code 3.
    """
