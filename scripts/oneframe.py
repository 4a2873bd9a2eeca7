"""The program ``oneframe`` of this checkout or extension, where it is not installed: the same commands and options.

python scripts/oneframe.py COMMAND ...
blender -b -P scripts/oneframe.py -- COMMAND ...

The folder ``pipeline`` holds the package ``oneframe``. Whoever has this script's folder on the module path and imports
``oneframe`` gets that package.
"""

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

if not hasattr(sys.modules.get("oneframe"), "__path__"):
    _spec = spec_from_file_location("oneframe", Path(__file__).resolve().parents[1] / "pipeline" / "__init__.py")
    assert _spec
    assert _spec.loader
    # in the place of this script, if that is being imported
    sys.modules["oneframe"] = module_from_spec(_spec)
    _spec.loader.exec_module(sys.modules["oneframe"])

if __name__ == "__main__":
    from oneframe.commands.__main__ import main

    main()
