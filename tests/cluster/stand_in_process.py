"""A render process that renders nothing: it speaks the protocol, and fails in the way that its first argument says.

Arguments: what it does at view number 3 (or as it starts), and a folder in which it leaves a file per view.
"""

import os
import signal
import sys
import time
from pathlib import Path

failure, folder = sys.argv[1], Path(sys.argv[2])

if failure == "no input":
    sys.stderr.write("error: frame.png: expected an image, found none\n")
    os._exit(2)
if failure == "defect":
    sys.stderr.write("ImportError: libX11.so.6\n")
    os._exit(1)
print("ready", flush=True)
for line in sys.stdin:
    view = int(line)
    if view == 3 and failure != "none":
        if failure == "crash":
            os.kill(os.getpid(), signal.SIGSEGV)
        if failure == "crash once" and not (folder / "crashed").exists():
            (folder / "crashed").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if failure == "hang":
            time.sleep(100)
        if failure == "no pose":
            sys.stderr.write("error: no pose meets the constraints\n")
            os._exit(2)
        if failure == "full disk":
            sys.stderr.write("error: the disk is full\n")
            os._exit(3)
    time.sleep(0.01)
    (folder / f"{view}-{os.getpid()}").touch()
    print(f"finished: {view}", flush=True)
