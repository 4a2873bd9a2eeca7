"""Enable the extension, find its tab in the sidebar, disable it: nothing is left behind."""

import addon_utils
import bpy
from left_behind import Code, only_in, registered

PACKAGE = "bl_ext.user_default.oneframe"


def scenario(user):
    before = registered()
    bpy.ops.preferences.addon_enable(module=PACKAGE)
    yield from user.open_sidebar("OneFrame")
    yield from user.picture("sidebar")
    code = Code(PACKAGE)
    bpy.ops.preferences.addon_disable(module=PACKAGE)
    yield from user.redraw()
    assert only_in(registered(), before) == {}
    assert code.still_held() == []
    assert addon_utils._extensions_warnings_get() == {}
