"""Plays one scenario in Blender's window and writes its result. Start Blender with ``-P driver.py -- SETTINGS``.

A scenario is a file ``scenario_*.py`` with a generator function ``scenario(user)``; see :mod:`user` for what it can do.
``SETTINGS`` is a JSON file, which names the file for the result, also JSON.
"""

import faulthandler
import json
import os
import sys
import threading
import time
import traceback
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

import importlib.util

import bpy
import user as at_window


def play(settings: dict) -> at_window.Action:
    """The scenario, from the first draw of the window."""
    # a scenario imports what it needs of the add-on
    bpy.ops.preferences.addon_enable(module=at_window.PACKAGE)
    user = at_window.User(Path(settings["case"]), Path(settings["folder"]), Path(settings["pictures"]))
    specification = importlib.util.spec_from_file_location("scenario", settings["scenario"])
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    start = time.monotonic()
    result = {"facts": user.facts}
    try:
        yield from user.redraw()
        user.facts["first_draw_s"] = round(time.monotonic() - start, 2)
        yield from module.scenario(user)
        result["passed"] = True
    except BaseException:
        result |= {"passed": False, "error": traceback.format_exc()}
        yield from user.picture("failed")
    finally:
        user.facts["seconds"] = round(time.monotonic() - start, 1)
        Path(settings["result"]).write_text(json.dumps(result))


def nap() -> float:
    """What Blender does between two events, unless they are simulated: then it would take a whole core to wait."""
    time.sleep(0.005)
    return 0.0


def give_up(seconds: float) -> None:
    """End a Blender that hangs, and print the stacks of all threads; needed if the test process is gone."""
    sys.stderr.write(f"driver: not finished after {seconds:g} s\n")
    faulthandler.dump_traceback(all_threads=True)
    os._exit(1)


def main() -> None:
    # output must not be lost when Blender is killed
    sys.stdout.reconfigure(line_buffering=True)
    settings = json.loads(Path(sys.argv[sys.argv.index("--") + 1]).read_text())
    preferences = bpy.context.preferences
    preferences.view.show_splash = False
    preferences.view.show_tooltips = False
    if not os.environ.get("ONEFRAME_SCREENSHOTS"):
        preferences.system.viewport_aa = "OFF"
        preferences.system.use_overlay_smooth_wire = False
    watchdog = threading.Timer(settings["timeout_s"], give_up, [settings["timeout_s"]])
    watchdog.daemon = True
    watchdog.start()
    steps = play(settings)

    def tick() -> float | None:
        try:
            return next(steps)
        except StopIteration:
            bpy.ops.wm.quit_blender()
        except BaseException:
            traceback.print_exc()
            sys.stderr.flush()
            os._exit(1)
        return None

    bpy.app.timers.register(tick, first_interval=0.1, persistent=True)
    bpy.app.timers.register(nap, persistent=True)


main()
