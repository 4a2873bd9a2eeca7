"""Written cases: read back to the last bit, wherever the files lie, or refused before anything is written."""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oneframe.camera.distortion import Distortion
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.case_changes import differing_fields
from oneframe.case.case_file import Case, Structure, read_case
from oneframe.case.case_writer import write_case
from oneframe.case.frame import UnreadFrame
from oneframe.case.landmarks import Landmark
from oneframe.case.pose_record import PoseRecord
from oneframe.dataset.description import object_name
from oneframe.errors import InputError
from oneframe.light.lens_light import LensLight
from oneframe.transforms import rigid, se3_exp

lengths = st.floats(-1e6, 1e6)
numbers = st.floats(allow_nan=False, allow_infinity=False)
any_text = st.text(st.characters(codec="utf-8"))
names = st.text(st.characters(codec="utf-8", exclude_categories=["Cc"]), min_size=1).filter(str.strip)
printable = st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), min_size=1, max_size=60)
file_names = st.text(st.characters(codec="utf-8", exclude_characters="/\0"), min_size=1).filter(
    lambda name: name not in (".", "..")
)
codes = st.integers(0, 255).map(lambda code: code / 255)


def maybe(strategy):
    return st.none() | strategy


landmarks = st.lists(
    st.builds(
        Landmark,
        name=names.map(str.strip),
        point=maybe(st.tuples(lengths, lengths, lengths)),
        pixel=maybe(st.tuples(numbers, numbers)),
        enabled=st.booleans(),
    ),
    max_size=4,
    unique_by=lambda landmark: landmark.name,
).map(tuple)
toml_values = st.recursive(
    st.booleans()
    | st.integers(-(2**63) + 1, 2**63 - 1)
    | st.floats(allow_nan=False)
    | any_text
    | st.dates()
    | st.times()
    | st.datetimes(timezones=maybe(st.just(UTC))),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(any_text, inner, max_size=3),
    max_leaves=8,
)
alignments = st.builds(
    PoseRecord,
    method=any_text,
    date=st.datetimes().map(datetime.isoformat),
    pairs=maybe(st.integers(0, 100)),
    rms_px=maybe(st.floats(0, 1e3)),
    standard_deviation_deg=maybe(st.tuples(*[st.floats(0, 1e3)] * 3)),
)
lamps = st.fixed_dictionaries(
    {
        "lamp_cam_mm": st.tuples(st.floats(-200, 200), st.floats(-200, 200), st.floats(-100, 200)),
        "ambient": st.floats(0, 1),
        "falloff": st.floats(0, 4),
        "vignetting": st.floats(0, 9),
    }
)
no_lamps = st.fixed_dictionaries({"lamp_cam_mm": st.none(), "ambient": st.just(1.0), "vignetting": st.floats(1, 9)})
lights = st.builds(
    lambda values, origin: LensLight(**values, origin=origin),
    values=lamps | no_lamps,
    origin=st.fixed_dictionaries(
        {}, optional={"method": any_text, "frames": st.integers(1, 9), "explained": st.floats(0, 1)}
    ),
)
cameras = st.builds(
    PinholeCamera,
    width=st.integers(1, 65536),
    height=st.integers(1, 65536),
    fx=st.floats(1e-3, 1e6),
    fy=st.floats(1e-3, 1e6),
    cx=st.floats(-1, 1),
    cy=st.floats(-1, 1),
)
poses = st.tuples(*[st.floats(-4, 4)] * 3, lengths, lengths, lengths).map(
    lambda numbers: rigid(se3_exp(np.array([0, 0, 0, *numbers[:3]]))[:3, :3], np.array(numbers[3:]))
)


distortions = maybe(st.just(Distortion(1e-30, -1e-45, 1e-30, 0.0, 1e-60)))


def further_frames(folder: Path):
    images = file_names.map(lambda name: folder / name)
    frame = st.builds(UnreadFrame, image=images, camera=cameras, distortion=distortions, cam_from_mesh=poses)
    return st.lists(frame, max_size=2, unique_by=lambda frame: frame.image).map(tuple)


@st.composite
def cases(draw, folder: Path = Path("/case")) -> Case:
    structures = draw(
        st.lists(
            st.builds(
                Structure,
                name=names,
                mesh=file_names.map(lambda name: folder / "structures" / name),
                colour=st.tuples(codes, codes, codes),
            ),
            max_size=2,
            unique_by=lambda structure: structure.name,
        )
    )
    return Case(
        path=folder / "case.toml",
        mm_per_unit=draw(st.sampled_from([1.0, 1000.0])),
        image=folder / draw(file_names),
        camera=draw(cameras),
        distortion=draw(distortions),
        mesh=folder / ".." / draw(file_names),
        object_name=draw(maybe(printable)),
        cam_from_mesh=draw(poses),
        frames=draw(further_frames(folder)),
        structures=tuple(structures),
        dataset=draw(st.dictionaries(any_text, toml_values, max_size=3)),
        landmarks=draw(landmarks),
        alignment=draw(alignments),
        light=draw(maybe(lights)),
        video=draw(maybe(st.tuples(names, st.integers(0, 2**62)))),
    )


def assert_equal(one: Case, other: Case) -> None:
    assert differing_fields(one, other) == ()
    for name in set(Case.__dataclass_fields__) - {"image", "mesh", "cam_from_mesh", "frames"}:
        assert getattr(one, name) == getattr(other, name), name
    for ours, theirs in zip(one.every_frame, other.every_frame, strict=True):
        assert (ours.camera, ours.distortion) == (theirs.camera, theirs.distortion)
        assert np.array_equal(ours.cam_from_mesh, theirs.cam_from_mesh)


@given(data=st.data())
def test_what_is_written_is_read_back(tmp_path_factory, data):
    case = data.draw(cases(tmp_path_factory.mktemp("written")))
    write_case(case.path, case, comment="of\ntwo lines")
    assert_equal(read_case(case.path), case)
    # a file's name may be a patient's
    assert object_name(case) == (case.object_name or "surface")


def simple_case(folder: Path) -> Case:
    return Case(
        path=folder / "case.toml",
        mm_per_unit=1.0,
        image=folder / "frame.png",
        camera=PinholeCamera(64, 48, 320.0, 330.0, 31.5, 23.5),
        distortion=None,
        mesh=folder / "surface.ply",
        cam_from_mesh=rigid(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 300.0])),
    )


def test_saved_elsewhere_a_case_names_the_same_files(tmp_path):
    (tmp_path / "bone").mkdir()
    (tmp_path / "cases/first").mkdir(parents=True)
    case = replace(simple_case(tmp_path / "bone"), dataset={"poses": "poses.npy", "count": 3})
    path = tmp_path / "cases/first/case.toml"
    write_case(path, case)
    assert 'mesh = "../../bone/surface.ply"' in path.read_text()
    again = read_case(path)
    assert (again.image.resolve(), again.mesh.resolve()) == (case.image, case.mesh)
    assert again.dataset == {"poses": "../../bone/poses.npy", "count": 3}


BAD = {
    "point": ({"landmarks": (Landmark("a", (np.nan, 0.0, 0.0), None),)}, "expected surface = .*3 finite numbers"),
    "pose": ({"cam_from_mesh": np.full((4, 4), np.nan)}, "cam_from_mesh: expected finite numbers"),
    "option": ({"dataset": {"count": None}}, "expected a value that TOML can hold, found None"),
    "file": ({"image": Path("\udcff.png")}, "expected names in Unicode"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_could_not_be_read_is_not_written(tmp_path, name):
    changes, message = BAD[name]
    with pytest.raises(InputError, match=message):
        write_case(tmp_path / "case.toml", replace(simple_case(tmp_path), **changes))
    assert not list(tmp_path.iterdir())
