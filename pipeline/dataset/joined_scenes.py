"""Datasets of one surface, such as those of a queue, as one of BOP's: their scenes one after the other.

The files are those of the datasets, by hard links where the file system has them: only numbers of scenes are new.
"""

import json
import os
import shutil
from collections.abc import Mapping
from pathlib import Path

from ..errors import InputError
from ..files.content import create_folder
from ..files.tables import write_csv, write_json
from .layout import MODEL_FILES, MODEL_FOLDERS, SCENE_TABLES, SCENES, SPLIT, TARGETS, scene_folder, view_kinds


def join_scenes(datasets: Mapping[str, Path], out: Path) -> None:
    """Write the scenes of finished datasets as one dataset of BOP's layout; an earlier one is replaced.

    Parameters
    ----------
    datasets
        Names -> folders. ``models/`` and ``camera.json`` are those of the first, each scene has its own K.
    out
        The folder to write; ``scenes.csv`` in it says which scene is whose.

    Raises
    ------
    InputError
        They are not of one surface.
    """
    partial = out.with_name(f".partial-{out.name}")
    shutil.rmtree(partial, ignore_errors=True)
    first = next(iter(datasets.values()))
    info = (first / "models" / "models_info.json").read_bytes()
    for folder in (*MODEL_FOLDERS, SPLIT):
        create_folder(partial / folder)
    for name in ("camera.json", *MODEL_FILES):
        _link(first / name, partial / name)
    owners: list[str] = []
    targets: list[dict[str, int]] = []
    for name, dataset in datasets.items():
        if (dataset / "models" / "models_info.json").read_bytes() != info:
            raise InputError(f"{dataset}: expected the surface of {first}, found another one; render them apart")
        begin = len(owners)
        for scene in sorted((dataset / SPLIT).iterdir()):
            _link_scene(scene, partial / scene_folder(len(owners)))
            owners.append(name)
        for target in json.loads((dataset / TARGETS).read_bytes()):
            targets.append(target | {"scene_id": target["scene_id"] + begin})
    write_json(partial / TARGETS, targets)
    write_csv(partial / SCENES, ("scene_id", "case"), list(enumerate(owners)))
    shutil.rmtree(out, ignore_errors=True)
    os.replace(partial, out)


def _link_scene(scene: Path, to: Path) -> None:
    create_folder(to)
    for name in SCENE_TABLES:
        _link(scene / name, to / name)
    # the records of views are OneFrame's own, and stay with their dataset
    for kind in view_kinds(float_depth=True, several_frames=True):
        if (scene / kind).is_dir():
            create_folder(to / kind)
            for file in sorted((scene / kind).iterdir()):
                _link(file, to / kind / file.name)


def _link(file: Path, to: Path) -> None:
    try:
        os.link(file, to)
    except OSError:
        # another file system, or one without links
        shutil.copyfile(file, to)
