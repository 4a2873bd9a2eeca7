"""Surfaces, cameras, independent oracles and a tiny case that several tests share."""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from pathlib import Path

import hypothesis
import numpy as np
import pytest

from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.case_file import Case
from oneframe.case.frame import PosedFrame
from oneframe.case.loaded_case import LoadedCase, LoadedSurface
from oneframe.files.lock import Busy, FileLock
from oneframe.images.png import encode_png
from oneframe.surface.mesh import TriangleMesh
from oneframe.surface.mesh_writer import write_ply
from oneframe.transforms import inverse_rigid, rigid, rotation_from_vector, transform_points

# a machine may be slow: no test measures time
hypothesis.settings.register_profile("any machine", deadline=None, max_examples=25)
hypothesis.settings.load_profile("any machine")

# before any import of bpy: a user's own Blender configuration must not reach the tests
os.environ.setdefault("BLENDER_USER_RESOURCES", tempfile.mkdtemp(prefix="oneframe-test-"))


@contextmanager
def alone(path: Path) -> Iterator[None]:
    """Wait until no other process holds this lock, hold it in the block, and remove its file in the end."""
    while True:
        with suppress(Busy, FileNotFoundError):
            lock = FileLock(path)
            break
        time.sleep(0.1)
    try:
        yield
    finally:
        with suppress(OSError):  # Windows removes no open files
            path.unlink()
        lock.release()


_EXIT_STATUS = pytest.StashKey[int]()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--long", action="store_true", help="tests/outside in full: hundreds of interruptions, …")


LONG = ("benchmarks", "cluster", "outside", "window")
"""Folders of tests that start many processes."""


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Each worker of `make test` would import, and prepare, what it does not run."""
    root = Path(__file__).parent
    skipped = config.getoption("markexpr") == "not long" and collection_path in [root / name for name in LONG]
    return True if skipped else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what takes long, and begin with what takes longest."""
    root = Path(__file__).parent
    for item in items:
        if item.path.relative_to(root).parts[0] in LONG:
            item.add_marker(pytest.mark.long)
    items.sort(key=lambda item: item.path.parent.name != "window")


@pytest.fixture(scope="session")
def long_form(request: pytest.FixtureRequest) -> bool:
    """Whether tests/outside runs in full; otherwise each of its tests takes a sample with a fixed seed."""
    return bool(request.config.getoption("--long"))


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    session.config.stash[_EXIT_STATUS] = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config: pytest.Config) -> None:
    """Print the processor time, of workers and what they started too; they have ended.

    Then exit at once: after OpenGL renders the bpy module may wait forever for its own threads when it is unloaded.
    """
    if not hasattr(config, "workerinput"):
        print(f"{sum(os.times()[:4]) / 60:.1f} min of processor time")
    if "bpy" in sys.modules and _EXIT_STATUS in config.stash:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(config.stash[_EXIT_STATUS])


@pytest.fixture(scope="session")
def once(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, Callable[[Path], None]], Path]:
    """Has a folder of this name filled by the first process of a run that asks; the others wait for it, and share it.

    No test may change what is in it. What fails is tried again by the next one.
    """
    base = tmp_path_factory.getbasetemp()
    base = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base

    def filled(name: str, fill: Callable[[Path], None]) -> Path:
        folder, done = base / name, base / f"{name}.done"
        with alone(base / f"{name}.lock"):
            if not done.exists():
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir()
                fill(folder)
                done.touch()
        return folder

    return filled


@pytest.fixture(scope="session")
def extension_zip(once: Callable[[str, Callable[[Path], None]], Path]) -> Path:
    """The extension, built for this computer by the command that users have."""

    def build(out: Path) -> None:
        script = Path(__file__).resolve().parents[1] / "scripts" / "dev" / "build_extension.py"
        ended = subprocess.run(
            [sys.executable, script, "--platform", "current", "--out", out], capture_output=True, text=True, check=False
        )
        if ended.returncode == 3:
            pytest.skip(ended.stderr.strip())
        assert ended.returncode == 0, ended.stderr
        assert ended.stderr == ""

    (path,) = once("extension", build).glob("*.zip")
    return path


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20)


def grid_mesh(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> TriangleMesh:
    """A triangulated grid of points, front towards +z."""
    rows, columns = z.shape
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return TriangleMesh(np.stack([x, y, z], -1).reshape(-1, 3).astype(float), faces.astype(np.int32))


def joined(*meshes: TriangleMesh) -> TriangleMesh:
    """Meshes as one."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)])
    return TriangleMesh(np.concatenate([mesh.vertices for mesh in meshes]), faces.astype(np.int32))


@pytest.fixture
def bumpy_mesh() -> TriangleMesh:
    """60 x 50 mm of hills and valleys, 6 mm high: hides parts of itself from low angles; demeaned."""
    x, y = np.meshgrid(np.linspace(-30, 30, 121), np.linspace(-25, 25, 101))
    z = 3 * np.sin(x / 3.1) * np.cos(y / 2.7) + 2 * np.exp(-((x / 8) ** 2) - (y / 8) ** 2)
    mesh = grid_mesh(x, y, z)
    return mesh.moved(-mesh.vertices.mean(axis=0))


@pytest.fixture
def stepped_mesh() -> TriangleMesh:
    """A 60 x 50 mm plate with a smaller one hovering 6 mm above it, which hides part of it; demeaned."""
    x, y = np.meshgrid(np.linspace(-30, 30, 61), np.linspace(-25, 25, 51))
    plate = grid_mesh(x, y, np.zeros_like(x))
    above = grid_mesh(x / 4 + 3, y / 4, np.full_like(x, 6.0))
    mesh = joined(plate, above)
    return mesh.moved(-mesh.vertices.mean(axis=0))


@pytest.fixture
def frontal_pose() -> np.ndarray:
    """300 mm above the surface, looking down on it."""
    return rigid(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, 300.0])


@pytest.fixture
def oblique_pose(frontal_pose: np.ndarray) -> np.ndarray:
    """The same, tilted by 24 degrees and rolled."""
    return frontal_pose @ rigid(rotation_from_vector(np.array([0.35, -0.2, 0.15])))


def intersect(
    mesh: TriangleMesh, camera: PinholeCamera, cam_from_model: np.ndarray, pixels: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Depth and face of the first hit along each ray, in float64, by rasterising with exact plane equations.

    Independent of Blender: for each triangle the edge functions are evaluated at the ``(N, 2)`` pixels near it.

    Returns
    -------
    ``(N,)`` depth in mm (0 for a miss) and ``(N,)`` face index (-1).
    """
    corners = transform_points(cam_from_model, mesh.vertices)[mesh.faces]
    rays = camera.rays_cam(pixels)
    projected = camera.project(corners.reshape(-1, 3)).reshape(-1, 3, 2)
    depth, hit = np.full(len(pixels), np.inf), np.full(len(pixels), -1)
    order = np.lexsort((pixels[:, 0], pixels[:, 1]))
    rows = pixels[order, 1]
    low, high = projected.min(axis=1), projected.max(axis=1)
    starts, ends = np.searchsorted(rows, low[:, 1]), np.searchsorted(rows, high[:, 1], side="right")
    for face in range(len(corners)):
        near = order[starts[face] : ends[face]]
        near = near[(pixels[near, 0] >= low[face, 0]) & (pixels[near, 0] <= high[face, 0])]
        if len(near) == 0:
            continue
        # ray = w0 a + w1 b + w2 c: all weights of one sign inside the triangle
        determinant = np.linalg.det(corners[face])
        if determinant == 0:
            continue
        weights = rays[near] @ np.linalg.inv(corners[face])
        total = weights.sum(axis=1)
        inside = (weights * np.sign(total)[:, None] >= 0).all(axis=1) & (total > 0)
        z = 1 / total[inside]
        target = near[inside]
        closer = z < depth[target]
        depth[target[closer]], hit[target[closer]] = z[closer], face
    return np.where(np.isfinite(depth), depth, 0), hit


@pytest.fixture
def ray_cast():
    """:func:`intersect`, as a fixture."""
    return intersect


@pytest.fixture
def sharp_image(rng: np.random.Generator):
    """Makes ``(H, W, 3)`` float32 8-bit code values with detail down to the pixel."""

    def make(camera: PinholeCamera) -> np.ndarray:
        v, u = np.mgrid[: camera.height, : camera.width]
        waves = [np.sin(u / 3.7 + k) * np.cos(v / (4.3 + k)) for k in range(3)]
        image = 0.5 + 0.3 * np.stack(waves, -1) + rng.normal(0, 0.05, (camera.height, camera.width, 3))
        return (np.rint(np.clip(image, 0, 1) * 255) / 255).astype(np.float32)

    return make


SCRIPT = Path(__file__).resolve().parents[1] / "scripts" / "render_dataset.py"
WIDTH, HEIGHT = 64, 48
SAME_FRAME = rigid()
OFFSET = np.array([12.0, -7.0, 40.0])
CASE = """
units = "mm"
[frame]
image = "frame.png"
[camera]
size = [64, 48]
K = [[320.0, 0, 30.0], [0, 318.0, 25.5], [0, 0, 1]]
[surface]
mesh = "surface.ply"
[pose]
cam_from_mesh = [[1, 0, 0, -12], [0, -1, 0, -7], [0, 0, -1, 340], [0, 0, 0, 1]]
"""


def tiny_surface() -> TriangleMesh:
    """60 x 50 mm of hills around :data:`OFFSET`, so that the mesh's own frame is not the demeaned one."""
    x, y = np.meshgrid(np.linspace(-30, 30, 31), np.linspace(-25, 25, 26))
    return grid_mesh(x, y, 3 * np.sin(x / 6) * np.cos(y / 5)).moved(OFFSET)


@pytest.fixture(scope="session")
def write_tiny_case() -> Callable[[Path], Path]:
    """Writes frame, surface and case file into a folder and gives the case file's path."""

    def write(folder: Path) -> Path:
        folder.mkdir(parents=True, exist_ok=True)
        v, u = np.mgrid[:HEIGHT, :WIDTH]
        image = np.stack([120 + 90 * np.sin(u / 9), 120 + 90 * np.cos(v / 7), 2.0 * u + v], -1)
        (folder / "frame.png").write_bytes(encode_png(image.astype(np.uint8)))
        write_ply(folder / "surface.ply", tiny_surface())
        (folder / "case.toml").write_text(CASE)
        return folder / "case.toml"

    return write


@pytest.fixture
def loaded_case(tmp_path: Path) -> Callable[..., LoadedCase]:
    """Makes a case in memory, without files, from a mesh (model frame, mm), a frame and its pose."""

    def make(
        mesh: TriangleMesh,
        image: np.ndarray,
        cam_from_model: np.ndarray,
        camera: PinholeCamera,
        valid: np.ndarray | None = None,
        *,
        mesh_from_model: np.ndarray = SAME_FRAME,
        mm_per_unit: float = 1.0,
    ) -> LoadedCase:
        case = Case(
            path=tmp_path / "case.toml",
            mm_per_unit=mm_per_unit,
            image=tmp_path / "frame.png",
            camera=camera,
            distortion=None,
            mesh=tmp_path / "surface.ply",
            cam_from_mesh=cam_from_model @ inverse_rigid(mesh_from_model),
        )
        valid = np.ones(camera.shape_hw, dtype=bool) if valid is None else valid
        return LoadedCase(
            case, LoadedSurface(mesh, mesh_from_model), (PosedFrame(image, valid, camera, cam_from_model),)
        )

    return make


@pytest.fixture(scope="session")
def render_command() -> Callable[..., list[str]]:
    """The command line of ``render_dataset.py`` by this Python, from any arguments."""
    return lambda *arguments: [sys.executable, str(SCRIPT), *map(str, arguments)]


@pytest.fixture(scope="session")
def run_command() -> Callable[..., subprocess.CompletedProcess]:
    """Runs a command to its end; more environment variables by keyword."""

    def run(command: list[str], **environment: str) -> subprocess.CompletedProcess:
        return subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | environment)

    return run


@pytest.fixture(scope="session")
def run_oneframe() -> Callable[..., subprocess.CompletedProcess]:
    """Runs the program ``oneframe`` to its end in this process, with any arguments."""

    def run(*arguments: object) -> subprocess.CompletedProcess:
        from oneframe.commands.__main__ import dispatch
        from oneframe.process.command_line import exit_code

        command, kept, written = [*map(str, arguments)], (os.dup(1), os.dup(2)), []
        with tempfile.TemporaryFile("a+") as out, tempfile.TemporaryFile("a+") as err:
            try:
                # the streams' numbers too: commands silence Blender by them
                os.dup2(out.fileno(), 1)
                os.dup2(err.fileno(), 2)
                with redirect_stdout(out), redirect_stderr(err):
                    code = exit_code(dispatch, command)
            finally:
                for number, own in enumerate(kept, start=1):
                    os.dup2(own, number)
                    os.close(own)
            for stream in (out, err):
                stream.seek(0)
                written.append(stream.read())
        return subprocess.CompletedProcess(command, code, *written)

    return run


@pytest.fixture
def addon():
    """The add-on, registered in an empty file as it is used from the checkout."""
    import bpy

    import blender_addon

    bpy.ops.wm.read_factory_settings(use_empty=True)
    blender_addon.register()
    yield blender_addon
    blender_addon.unregister()
