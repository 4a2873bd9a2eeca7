"""Enables, disables and removes the installed extension in this Blender; reports as one line of JSON.

Run by ``test_extension.py``.
"""

import importlib
import json
import pkgutil
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

import bpy  # brings the folder of addon_utils

import addon_utils  # isort: skip
from left_behind import Code, only_in, registered

PACKAGE = "bl_ext.user_default.oneframe"


def modules_of_addon() -> list[str]:
    """Every module of the add-on, without those of the pipeline, which it imports when it needs them."""
    found = pkgutil.walk_packages(sys.modules[PACKAGE].__path__, f"{PACKAGE}.")
    parts = (f"{PACKAGE}.pipeline", f"{PACKAGE}.scripts", f"{PACKAGE}.wheels")
    return [module.name for module in found if not module.name.startswith(parts)]


addon_utils.extensions_refresh(ensure_wheels=True)
before = registered()
bpy.ops.preferences.addon_enable(module=PACKAGE)
for name in modules_of_addon():
    importlib.import_module(name)
added = only_in(registered(), before)
# Blender looks for such imports before the next draw of the preferences
warnings = {name: list(some) for name, some in addon_utils._extensions_warnings_get().items()}
code = Code(PACKAGE)
bpy.ops.preferences.addon_disable(module=PACKAGE)
left = only_in(registered(), before)
found = {"added": added, "warnings": warnings, "left": left, "held": code.still_held()}
found["cv2"] = importlib.import_module("cv2").__file__
found["numpy"] = importlib.import_module("numpy").__file__
repository = [repository.module for repository in bpy.context.preferences.extensions.repos].index("user_default")
bpy.ops.extensions.package_uninstall(repo_index=repository, pkg_id="oneframe")
print(json.dumps(found))
