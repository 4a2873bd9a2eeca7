"""What every reader and writer of files obeys.

In: a path, or the bytes of a file. Out: its content, checked, or one error that says what was expected; and files that
are written whole or not at all.
"""
