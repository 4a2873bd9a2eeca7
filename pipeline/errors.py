"""The one exception that a user is meant to read."""


class InputError(ValueError):
    """Something given by the user cannot be used.

    The message is one sentence (or two) that says where, what was expected, what was found and what to do. Scripts
    print it as one line and exit with 2; operators report it. Every other exception is a defect of the program.
    """
