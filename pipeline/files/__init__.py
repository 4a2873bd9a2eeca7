"""The rules that every reader and writer of files follows.

In: a path, or the bytes of a file. Out: its checked content, or one error that says what was expected; and files
written whole or not at all.
"""
