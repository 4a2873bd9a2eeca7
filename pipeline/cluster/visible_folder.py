"""On a worker: whether a folder is the one that the run's machine writes to."""

import time
from pathlib import Path

from ..dataset.folder import run_token
from ..errors import RunError

_seen: set[tuple[str, str]] = set()


def check_visible(run: str, folder: str, client: str, look_seconds: float, instead: str) -> None:
    """Check that a folder has the token of a run, which a network file system may show a little later.

    Parameters
    ----------
    run
        The run's name.
    folder
        Its folder.
    client
        Name of its machine, for the message.
    look_seconds
        How long to look.
    instead
        What to do if nothing is shared, for the message.

    Raises
    ------
    RunError
        The folder is another one, or missing.
    """
    if (run, folder) in _seen:
        return
    token, give_up = run_token(Path(folder), run), time.monotonic() + look_seconds
    while not token.exists():
        if time.monotonic() > give_up:
            what = "has no such folder" if not Path(folder).is_dir() else "has another folder of this name"
            raise RunError(
                f"it does not see the folder that {client} writes to: {folder}; the machine {what}. Mount the shared "
                f"folder there at the same path, {instead}"
            )
        time.sleep(min(0.2, look_seconds))
    _seen.add((run, folder))
