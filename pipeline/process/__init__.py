"""The process of a command: its arguments and exit code, its streams, signals and temporary files.

In: what the user typed. Out: messages, an exit code, and nothing left behind.
"""
