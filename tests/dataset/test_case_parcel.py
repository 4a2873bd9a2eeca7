"""A case that travels: the same values under names of its own, whatever folders its files were in."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from oneframe.case.case_file import case_from_text, read_case
from oneframe.dataset.options import DatasetOptions
from oneframe.dataset.run.elsewhere import CASE, case_parcel


def unpack(parcel, root: Path) -> None:
    for name, content in parcel.files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def test_a_case_arrives_as_it_was(tmp_path):
    path = tmp_path / "here/of all/case.toml"
    path.parent.mkdir(parents=True)
    for name in ("../frame.png", "bone.ply", "chorda.ply", "../chorda.ply", "../list.npy"):
        (path.parent / name).write_bytes(name.encode())
    text = """
units = "m"
[frame]
image = "../frame.png"
[camera]
size = [640, 480]
K = [[1000.1, 0, 320.3], [0, 999.9, 240.7], [0, 0, 1]]
pixel_origin = "corner"
[surface]
mesh = "bone.ply"
[pose]
cam_from_mesh = [[0.6, -0.8, 0, 0.0123456789], [0.8, 0.6, 0, -0.3], [0, 0, 1, 0.4321], [0, 0, 0, 1]]
[dataset]
cone_deg = 30
"""
    text += "".join(
        f'[[structures]]\nname = "{name}"\nmesh = "{mesh}"\n'
        for name, mesh in (("chorda", "chorda.ply"), ("other", "../chorda.ply"))
    )
    path.write_text(text)
    case = read_case(path)
    parcel = case_parcel(case, DatasetOptions(poses=str(path.parent / "../list.npy")))
    unpack(parcel, tmp_path / "there")
    arrived = read_case(tmp_path / "there" / CASE)
    assert arrived.camera == case.camera
    assert np.array_equal(arrived.cam_from_mesh, case.cam_from_mesh)
    assert [(s.name, s.colour) for s in arrived.structures] == [(s.name, s.colour) for s in case.structures]
    # the names of the files may name the patient
    assert parcel.files.keys() == {CASE, "frame.png", "surface.ply", "structure_0.ply", "structure_1.ply", "poses.npy"}
    there, here = arrived.input_files(), case.input_files()
    assert there.keys() == here.keys()
    assert all(there[name].read_bytes() == here[name].read_bytes() for name in there if name != "case")
    assert (tmp_path / "there" / parcel.poses).read_bytes() == b"../list.npy"
    tools = DatasetOptions(occluders=1.0, occluder_meshes=str(path.parent))
    sent = {name for name in case_parcel(case, tools).files if name.startswith("instruments/")}
    assert sent == {f"instruments/{number:06d}.ply" for number in range(len([*path.parent.glob("*.ply")]))}
    moved = replace(case, path=tmp_path / "elsewhere.toml")
    assert case_parcel(moved, DatasetOptions()).files[CASE] == parcel.files[CASE]
    assert case_from_text(parcel.files[CASE], tmp_path / "x.toml").dataset == {}
