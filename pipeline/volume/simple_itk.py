"""SimpleITK, which reads volumes and finds connected parts: loaded when it is needed."""

from typing import Any

from ..errors import InputError


def simple_itk() -> Any:
    """The library, silent: its warnings quote lines of headers, which may name the patient.

    Raises
    ------
    InputError
        It is not installed.
    """
    try:
        # a session without a CT need not load it
        import SimpleITK as sitk
    except ImportError:
        raise InputError(
            "volumes: expected the package SimpleITK, which reads CT, this Python has none; install it with "
            'pip install "SimpleITK>=2.5", or use a Blender in which the OneFrame extension is enabled'
        ) from None
    sitk.ProcessObject.SetGlobalWarningDisplay(False)
    return sitk
