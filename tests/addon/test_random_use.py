"""Random sequences of the add-on's operators and Blender's own end in messages, never in tracebacks."""

import random
from pathlib import Path

import bpy
import pytest

pytestmark = [pytest.mark.long, pytest.mark.render]

STEPS = 200
LANDMARKS = "".join(
    f'\n[[landmarks]]\nname = "{name}"\nsurface = {surface}\npixel = {pixel}\n'
    for name, surface, pixel in [
        ("A", [1.25, -7.5, 41.0], [20.25, 30.5]),
        ("B", [10.25, -7.5, 41.0], [40.25, 30.5]),
        ("C", [1.25, -17.5, 41.0], [20.25, 40.5]),
        ("D", [15.25, -17.5, 38.0], [43.25, 40.5]),
    ]
)
TRIED = (0, 1, 2, 5, -1, 0.5, 100, -37.5, 1e6)


class RandomUser:
    """Performs random actions; Blender's own undo step follows each, as in its window."""

    def __init__(self, case: Path, seed: int) -> None:
        self.case, self.rng = case, random.Random(seed)
        self.log: list[str] = []
        self.operators = [name for name in dir(bpy.ops.oneframe)]
        often = [self.operator] * 12 + [self.setting] * 5 + [self.undo] * 4 + [self.object] * 2 + [self.mode] * 2
        self.actions = [*often, self.delete, self.scene, self.reopen, *[self.open_case] * 3]

    def step(self) -> None:
        action = self.rng.choice(self.actions)
        try:
            action()
            bpy.context.view_layer.update()
        except RuntimeError as report:
            # the message of a cancelled operator, or the traceback of an error in it
            if "Traceback" in str(report):
                report.add_note("\n".join(self.log[-20:]))
                raise
        if action not in (self.undo, self.reopen):
            bpy.ops.ed.undo_push(message=self.log[-1][:40])

    def value(self, declared: bpy.types.Property) -> object:
        """Any value that the property accepts; ``None`` for types that the user does not set."""
        rng, count = self.rng, getattr(declared, "array_length", 0)
        if declared.type in ("INT", "FLOAT"):
            kind = int if declared.type == "INT" else float
            values = [
                kind(max(min(rng.choice(TRIED), declared.hard_max), declared.hard_min)) for _ in range(count or 1)
            ]
        elif declared.type == "BOOLEAN":
            values = [rng.random() < 0.5 for _ in range(count or 1)]
        elif declared.type == "ENUM":
            return rng.choice([item.identifier for item in declared.enum_items])
        elif declared.type == "STRING":
            folder = self.case.parent
            names = ("case.toml", "frame.png", "surface.ply", "pairs.csv", "pairs.json", "out.glb", "none/a.toml")
            return rng.choice(["", "x", "1 2 3", "//relative", *(str(folder / name) for name in names)])
        else:
            return None
        return values if count else values[0]

    def operator(self) -> None:
        name = self.rng.choice(self.operators)
        operator = getattr(bpy.ops.oneframe, name)
        declared = [one for one in operator.get_rna_type().properties if not one.is_readonly]
        chosen = [one for one in declared if self.rng.random() < 0.6]
        arguments = {one.identifier: value for one in chosen if (value := self.value(one)) is not None}
        self.log.append(f"oneframe.{name} {arguments}")
        operator(**arguments)

    def setting(self) -> None:
        settings = bpy.context.scene.oneframe
        group = self.rng.choice([settings, settings.dataset, settings.camera, *settings.landmarks])
        shown = [one for one in group.bl_rna.properties if not (one.is_readonly or one.is_hidden)]
        declared = self.rng.choice([one for one in shown if one.identifier != "name"])
        value = self.value(declared)
        self.log.append(f"{group.bl_rna.identifier}.{declared.identifier} = {value}")
        if value is not None:
            setattr(group, declared.identifier, value)

    def undo(self) -> None:
        name = self.rng.choice(["undo", "undo", "redo"])
        self.log.append(name)
        getattr(bpy.ops.ed, name)()

    def mode(self) -> None:
        found = self.rng.choice([None, *bpy.context.view_layer.objects])
        bpy.context.view_layer.objects.active = found
        is_mesh = found is not None and found.type == "MESH"
        mode = self.rng.choice(["EDIT", "SCULPT", "VERTEX_PAINT", "OBJECT"]) if is_mesh else "OBJECT"
        self.log.append(f"mode {mode}")
        bpy.ops.object.mode_set(mode=mode)

    def object(self) -> None:
        name = self.rng.choice(["scale", "move", "hide", "unlink", "empty"])
        found = self.rng.choice([None, *bpy.context.view_layer.objects])
        self.log.append(f"{name} {found and found.name}")
        match found and name:
            case "scale":
                found.scale = (self.rng.choice([0, -1, 1, 1.1]), 1, 1)
            case "move":
                found.location = [self.rng.uniform(-50, 50) for _ in range(3)]
            case "hide":
                found.hide_viewport = not found.hide_viewport
            case "unlink":
                found.users_collection[0].objects.unlink(found)
            case "empty" if found.type == "MESH":
                found.data.clear_geometry()

    def delete(self) -> None:
        kind = self.rng.choice(["objects", "objects", "images", "meshes", "cameras", "materials", "collections"])
        blocks = getattr(bpy.data, kind)
        found = self.rng.choice([None, *blocks])
        self.log.append(f"delete {kind} {found and found.name}")
        if found is not None:
            blocks.remove(found)

    def scene(self) -> None:
        what = self.rng.choice(["new", "copy", "remove"])
        self.log.append(f"scene {what}")
        if what == "new":
            bpy.context.window.scene = bpy.data.scenes.new("another")
        elif what == "copy":
            bpy.context.window.scene = bpy.context.scene.copy()
        elif len(bpy.data.scenes) > 1:
            bpy.data.scenes.remove(bpy.context.scene)

    def reopen(self) -> None:
        self.log.append("save and reopen")
        file = str(self.case.parent / "work.blend")
        bpy.ops.wm.save_as_mainfile(filepath=file)
        bpy.ops.wm.open_mainfile(filepath=file)

    def open_case(self) -> None:
        self.log.append("open the case")
        bpy.ops.oneframe.open_case(filepath=str(self.case))


@pytest.mark.parametrize("seed", range(2))
def test_random_use_raises_no_tracebacks(addon, write_tiny_case, tmp_path, monkeypatch, capfd, seed):
    # names without a folder refer to this one
    monkeypatch.chdir(tmp_path)
    case = write_tiny_case(tmp_path)
    case.write_text(case.read_text() + LANDMARKS + "\n[dataset]\ncount = 4\n")
    user = RandomUser(case, seed)
    user.open_case()
    bpy.ops.ed.undo_push(message="start")
    for _ in range(STEPS):
        user.step()
    # errors in handlers and updates are only printed
    assert "Traceback" not in "".join(capfd.readouterr()), "\n".join(user.log)
