"""A process that packs: orders come in by standard input, views and shards are reported by standard output.

It ends when its input does, or at the next view after its parent is gone. Both directions are pickles between a program
and its own child.
"""

import os
import pickle
import sys


def main() -> None:
    """Pack what is ordered until there is no more."""
    out = os.fdopen(os.dup(1), "wb")
    # libraries print what they like
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)

    def report(message: object) -> None:
        pickle.dump(message, out)
        out.flush()

    from .shard import pack_shard

    try:
        while True:
            try:
                order = pickle.load(sys.stdin.buffer)
            except EOFError:
                return
            try:
                report(pack_shard(order, lambda: report(None)))
            except BrokenPipeError:
                raise
            except Exception as error:  # the parent raises it
                report(error)
    except BrokenPipeError:
        os._exit(1)


if __name__ == "__main__":
    main()
