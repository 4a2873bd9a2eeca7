"""Datasets of a queue as one of BOP's: their scenes one after the other, and each of their surfaces as an object.

The files are those of the datasets, by hard links where the file system has them: only numbers of scenes are new, and
numbers of objects where there are several. K and the size of a frame are those of each scene.
"""

import json
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..files.content import create_folder
from ..files.lock import alone
from ..files.tables import write_csv, write_json
from .dataset_file import read_description
from .layout import (
    MODEL_FOLDERS,
    OBJECT_ID,
    RECORD,
    SCENE_TABLES,
    SCENES,
    SPLIT,
    TARGETS,
    eyes_of,
    scene_folder,
)
from .options import RIGHT
from .truths import TRUTHS


def join_scenes(datasets: Mapping[str, Path], out: Path) -> None:
    """Write the scenes of finished datasets as one dataset of BOP's layout; an earlier one is replaced.

    Parameters
    ----------
    datasets
        Names -> folders. Those of one surface, by its ``geometry_sha256``, have one object; ``camera.json`` is that of
        the first. If all have right eyes, these are joined too, to the folder of them.
    out
        The folder to write. ``scenes.csv`` beside it says which scene is whose: names may be those of patients.
    """
    with alone(out.with_name(f".{out.name}.lock")):
        partial = out.with_name(f".partial-{out.name}")
        shutil.rmtree(partial, ignore_errors=True)
        owners = _write_scenes(datasets, partial)
        rights = {name: eyes_of(folder)[-1] for name, folder in datasets.items()}
        if all(rights[name] != folder for name, folder in datasets.items()):
            _write_scenes(rights, partial / RIGHT)
        # never a list of other scenes
        table = out.with_name(SCENES)
        table.unlink(missing_ok=True)
        shutil.rmtree(out, ignore_errors=True)
        os.replace(partial, out)
        write_csv(table, ("scene_id", "obj_id", "case"), [(scene, *owner) for scene, owner in enumerate(owners)])


def _write_scenes(datasets: Mapping[str, Path], to: Path) -> list[tuple[int, str]]:
    """Write the scenes of one eye; gives the number of the object of each, and whose it is."""
    for folder in (*MODEL_FOLDERS, SPLIT):
        create_folder(to / folder)
    _link(next(iter(datasets.values())) / "camera.json", to / "camera.json")
    objects: dict[object, int] = {}
    owners: list[tuple[int, str]] = []
    targets: list[dict[str, int]] = []
    for name, dataset in datasets.items():
        surface = read_description(dataset / RECORD).content.get("geometry_sha256")
        number = objects.setdefault(surface, OBJECT_ID + len(objects))
        _add_model(dataset, to, number)
        begin = len(owners)
        for scene in sorted((dataset / SPLIT).iterdir()):
            _link_scene(scene, to / scene_folder(len(owners)), number)
            owners.append((number, name))
        for target in json.loads((dataset / TARGETS).read_bytes()):
            targets.append(target | {"scene_id": target["scene_id"] + begin, "obj_id": number})
    write_json(to / TARGETS, targets)
    return owners


def _add_model(dataset: Path, to: Path, number: int) -> None:
    """Add a dataset's model under the number of its object, unless it is there already."""
    for folder in MODEL_FOLDERS:
        model = to / folder / f"obj_{number:06d}.ply"
        if model.exists():
            return
        _link(dataset / folder / f"obj_{OBJECT_ID:06d}.ply", model)
        infos = to / folder / "models_info.json"
        known = json.loads(infos.read_bytes()) if infos.exists() else {}
        (info,) = json.loads((dataset / folder / infos.name).read_bytes()).values()
        write_json(infos, known | {str(number): info})


def _link_scene(scene: Path, to: Path, number: int) -> None:
    create_folder(to)
    for name in SCENE_TABLES:
        if number == OBJECT_ID:
            _link(scene / name, to / name)
        else:
            write_json(to / name, _renumbered(json.loads((scene / name).read_bytes()), number), indent=None)
    # the records of views are OneFrame's own, and stay with their dataset
    for kind in TRUTHS:
        if (scene / kind).is_dir():
            create_folder(to / kind)
            for file in sorted((scene / kind).iterdir()):
                _link(file, to / kind / file.name)


def _renumbered(table: Any, number: int) -> Any:
    """A table of a scene with another number of its one object: in BOP's truth, and as COCO's category."""
    if isinstance(table, list):
        return [_renumbered(entry, number) for entry in table]
    if not isinstance(table, dict):
        return table
    changed = {key: _renumbered(value, number) for key, value in table.items()}
    changed |= {key: number for key in ("obj_id", "category_id") if key in table}
    if "categories" in table:
        changed["categories"] = [entry | {"id": number} for entry in table["categories"]]
    return changed


def _link(file: Path, to: Path) -> None:
    try:
        os.link(file, to)
    except OSError:
        # another file system, or one without links
        shutil.copyfile(file, to)
