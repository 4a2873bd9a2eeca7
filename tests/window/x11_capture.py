"""Captures the picture of an X11 display through Xlib.

With OpenGL in software, Blender's own screenshot operators give black pictures and still return FINISHED.
"""

import ctypes
import os

import numpy as np

Z_PIXMAP = 2
ALL_PLANES = 0xFFFFFFFF


class XImage(ctypes.Structure):
    """The first fields of Xlib's structure, up to the last one used here."""

    _fields_ = [
        *((name, ctypes.c_int) for name in ("width", "height", "xoffset", "format")),
        ("data", ctypes.c_void_p),
        *((name, ctypes.c_int) for name in ("byte_order", "bitmap_unit", "bitmap_bit_order", "bitmap_pad", "depth")),
        *((name, ctypes.c_int) for name in ("bytes_per_line", "bits_per_pixel")),
    ]


def capture() -> np.ndarray:
    """The whole display named by ``DISPLAY``, ``(H, W, 3)`` uint8 RGB.

    Raises
    ------
    OSError
        The display cannot be opened, or has other than 24-bit colour.
    """
    xlib = ctypes.CDLL("libX11.so.6")
    xlib.XOpenDisplay.restype = ctypes.c_void_p
    xlib.XDefaultRootWindow.restype = ctypes.c_ulong
    xlib.XGetImage.restype = ctypes.POINTER(XImage)
    if not (address := xlib.XOpenDisplay(os.environ["DISPLAY"].encode())):
        raise OSError(f"cannot open the display {os.environ['DISPLAY']}")
    display = ctypes.c_void_p(address)
    try:
        width, height = xlib.XDisplayWidth(display, 0), xlib.XDisplayHeight(display, 0)
        root = ctypes.c_ulong(xlib.XDefaultRootWindow(display))
        pointer = xlib.XGetImage(display, root, 0, 0, width, height, ctypes.c_ulong(ALL_PLANES), Z_PIXMAP)
        image = pointer.contents
        if image.bits_per_pixel != 32:
            raise OSError(f"expected a display of 24-bit colour in 32 bits, found {image.bits_per_pixel} bits")
        rows = np.frombuffer(ctypes.string_at(image.data, image.bytes_per_line * height), np.uint8)
        xlib.XFree(ctypes.c_void_p(image.data))
        xlib.XFree(pointer)
    finally:
        xlib.XCloseDisplay(display)
    bgrx = rows.reshape(height, -1)[:, : 4 * width].reshape(height, width, 4)
    return np.ascontiguousarray(bgrx[..., 2::-1])
