"""The X11 display through Xlib: its picture, and the cross of a window.

With OpenGL in software, Blender's own screenshot operators give black pictures and still return FINISHED.
"""

import ctypes
import os
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

Z_PIXMAP = 2
ALL_PLANES = 0xFFFFFFFF
CLIENT_MESSAGE = 33


class XImage(ctypes.Structure):
    """The first fields of Xlib's structure, up to the last one used here."""

    _fields_ = [
        *((name, ctypes.c_int) for name in ("width", "height", "xoffset", "format")),
        ("data", ctypes.c_void_p),
        *((name, ctypes.c_int) for name in ("byte_order", "bitmap_unit", "bitmap_bit_order", "bitmap_pad", "depth")),
        *((name, ctypes.c_int) for name in ("bytes_per_line", "bits_per_pixel")),
    ]


class XClientMessageEvent(ctypes.Structure):
    """Xlib's structure, as large as its union ``XEvent``."""

    _fields_ = [
        ("type", ctypes.c_int),
        ("serial", ctypes.c_ulong),
        ("send_event", ctypes.c_int),
        ("display", ctypes.c_void_p),
        ("window", ctypes.c_ulong),
        ("message_type", ctypes.c_ulong),
        ("format", ctypes.c_int),
        ("data", ctypes.c_long * 17),
    ]


@contextmanager
def connected(name: str) -> Iterator[tuple[ctypes.CDLL, ctypes.c_void_p, ctypes.c_ulong]]:
    """Connect to a display; yields Xlib, the connection and the root window. Raises OSError if there is none."""
    xlib = ctypes.CDLL("libX11.so.6")
    xlib.XOpenDisplay.restype = ctypes.c_void_p
    for returning_an_id in (xlib.XDefaultRootWindow, xlib.XInternAtom):
        returning_an_id.restype = ctypes.c_ulong
    if not (address := xlib.XOpenDisplay(name.encode())):
        raise OSError(f"cannot open the display {name}")
    display = ctypes.c_void_p(address)
    try:
        yield xlib, display, ctypes.c_ulong(xlib.XDefaultRootWindow(display))
        xlib.XSync(display, 0)
    finally:
        xlib.XCloseDisplay(display)


@contextmanager
def with_crosses(name: str) -> Iterator[None]:
    """What a window manager does first: without the message's name on the display, Blender does not listen to it."""
    with connected(name) as (xlib, display, _):
        xlib.XInternAtom(display, b"WM_DELETE_WINDOW", 0)
        xlib.XSync(display, 0)
        yield


def click_cross() -> None:
    """Tell each window of the display named by ``DISPLAY`` what a window manager tells it when its cross is clicked."""
    with connected(os.environ["DISPLAY"]) as (xlib, display, root):
        ids, windows, count = (ctypes.c_ulong * 2)(), ctypes.POINTER(ctypes.c_ulong)(), ctypes.c_uint()
        xlib.XQueryTree(display, root, ids, ctypes.byref(ids, 8), ctypes.byref(windows), ctypes.byref(count))
        for window in windows[: count.value]:
            message = XClientMessageEvent(type=CLIENT_MESSAGE, window=window, format=32)
            message.message_type = xlib.XInternAtom(display, b"WM_PROTOCOLS", 0)
            message.data[0] = xlib.XInternAtom(display, b"WM_DELETE_WINDOW", 0)
            xlib.XSendEvent(display, ctypes.c_ulong(window), 0, ctypes.c_long(0), ctypes.byref(message))
        xlib.XFree(windows)


def capture() -> np.ndarray:
    """The whole display named by ``DISPLAY``, ``(H, W, 3)`` uint8 RGB.

    Raises
    ------
    OSError
        The display cannot be opened, or has other than 24-bit colour.
    """
    with connected(os.environ["DISPLAY"]) as (xlib, display, root):
        width, height = xlib.XDisplayWidth(display, 0), xlib.XDisplayHeight(display, 0)
        xlib.XGetImage.restype = ctypes.POINTER(XImage)
        pointer = xlib.XGetImage(display, root, 0, 0, width, height, ctypes.c_ulong(ALL_PLANES), Z_PIXMAP)
        image = pointer.contents
        if image.bits_per_pixel != 32:
            raise OSError(f"expected a display of 24-bit colour in 32 bits, found {image.bits_per_pixel} bits")
        rows = np.frombuffer(ctypes.string_at(image.data, image.bytes_per_line * height), np.uint8)
        xlib.XFree(ctypes.c_void_p(image.data))
        xlib.XFree(pointer)
    bgrx = rows.reshape(height, -1)[:, : 4 * width].reshape(height, width, 4)
    return np.ascontiguousarray(bgrx[..., 2::-1])
