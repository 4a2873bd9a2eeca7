"""Films with overlays: each frame as the picture of its pose, at its time, whatever the film is like."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from oneframe.camera.distortion import Distortion, undistort
from oneframe.camera.pinhole import PinholeCamera
from oneframe.case.case_file import Structure
from oneframe.errors import InputError
from oneframe.overlay.overlay_film import FrameMark, OverlayFilm, opened_film
from oneframe.overlay.overlay_picture import OverlayPainter
from oneframe.sample.distance_field import tube
from oneframe.transforms import rigid
from oneframe.video.film_reader import WIDEST, Film
from tests.images.test_overlay import block_letters
from tests.video.difficult_films import write_images
from tests.video.surgical_film import write_film

CAMERA = PinholeCamera(320, 240, fx=1600.0, fy=1590.0, cx=161.2, cy=118.4)
FRAMES = 10


@pytest.fixture
def loaded(loaded_case, bumpy_mesh, frontal_pose, tmp_path):
    """A nerve that runs out of the hills and into them."""
    nerve = tube(np.array([[-20.0, -6, 1], [-5, 8, 4], [8, -4, 1], [22, 6, -5]]), 1.5)
    case = loaded_case(bumpy_mesh, np.zeros((*CAMERA.shape_hw, 3), np.float32), frontal_pose, CAMERA)
    structures = ((Structure("facial_nerve", tmp_path / "n.ply", (1.0, 0.0, 1.0)), nerve),)
    return replace(case, surface=replace(case.surface, structures=structures))


def film_frames() -> list[np.ndarray]:
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    wave = np.stack([40 + u / 3, 120 + 60 * np.sin(v / 9), 0 * u + 90], axis=-1)
    # a bright bar that moves
    frames = [np.where((np.abs(u - 20 * k - 25) < 10)[..., None], 225, wave) for k in range(FRAMES)]
    return [frame.astype(np.uint8) for frame in frames]


def film_poses(frontal_pose: np.ndarray) -> list[np.ndarray | None]:
    poses: list[np.ndarray | None] = [
        rigid(translation=np.array([k - 5.0, 0.3 * k, 0])) @ frontal_pose for k in range(FRAMES)
    ]
    poses[3] = None
    poses[6] = rigid(translation=np.array([900.0, 0, 0])) @ frontal_pose
    return poses


def drawn(path, loaded, poses):
    """The drawing, messages, and all pictures."""
    listed = path.with_suffix(".npy")
    np.save(listed, np.array([np.full((4, 4), np.nan) if pose is None else pose for pose in poses]))
    shown = []
    with opened_film(path, listed, loaded) as (film, found, messages):
        drawing = OverlayFilm(loaded, film, found, block_letters)
        pictures = list(drawing.pictures(lambda: shown.append(1)))
    assert len(shown) == len(pictures) == drawing.count
    return drawing, messages, pictures


def decoded(path) -> list[np.ndarray]:
    with Film(path, width=WIDEST) as film:
        return [frame.image for frame in film]


def distance(image: np.ndarray, expected: np.ndarray) -> float:
    return float(np.abs(image.astype(float) - expected).mean())


def test_every_frame_is_the_picture_of_its_pose(loaded, frontal_pose, tmp_path):
    poses = film_poses(frontal_pose)
    path = write_film(tmp_path / "film.mkv", film_frames(), fps=30000 / 1001)
    drawing, messages, found = drawn(path, loaded, poses)
    assert messages == []
    assert drawing.lines() == [
        f"{FRAMES} frames, {FRAMES - 2} with overlay, 1 without pose, 1 whose pose does not show the surface"
    ]
    assert len(found) == FRAMES
    assert drawing.fps == pytest.approx(30000 / 1001, rel=1e-4)
    painter = OverlayPainter(loaded, CAMERA, block_letters)
    for image, pose, picture in zip(decoded(path), poses, found, strict=True):
        assert np.array_equal(picture, image if pose is None else painter.paint(image, pose).image)


def test_a_frame_that_is_less_sure_is_fainter_and_marked(loaded, frontal_pose, tmp_path):
    red = (210, 60, 50)
    path = write_film(tmp_path / "film.mkv", film_frames()[:3])
    marks = {0: FrameMark(0.4), 1: FrameMark(0.4, red, "doubtful"), 2: FrameMark(0.0, red, "refused")}
    with Film(path) as film:
        drawing = OverlayFilm(loaded, film, [frontal_pose] * 2 + [None], None, marks=marks)
        found = list(drawing.pictures(lambda: None))
    painter, images = OverlayPainter(loaded, CAMERA, None), decoded(path)
    expected = [image + 0.4 * (painter.paint(image, frontal_pose).image - image.astype(float)) for image in images]
    expected[2] = images[2]
    for number, (image, picture) in enumerate(zip(found, expected, strict=True)):
        assert distance(image[30:-10, 10:-10], picture[30:-10, 10:-10]) < 3
        assert (image[-2:] == red).all() == (number > 0)


def test_a_film_of_another_size_scales_k_and_other_proportions_are_refused(loaded, frontal_pose, tmp_path):
    poses = [frontal_pose] * 3
    path = write_film(tmp_path / "small.mkv", [image[::2, ::2] for image in film_frames()[:3]])
    drawing, messages, found = drawn(path, loaded, poses)
    assert messages == ["small.mkv: 160x120 px, the K of 320x240 is scaled to it"]
    assert drawing.counts["drawn"] == 3
    painter = OverlayPainter(loaded, CAMERA.resized(160, 120), block_letters)
    assert np.array_equal(found[1], painter.paint(decoded(path)[1], frontal_pose).image)
    for size in ((160, 90), (240, 320)):
        with pytest.raises(InputError, match=r"film.mp4: expected the proportions .* 320x240 px, found \d+x"):
            CAMERA.for_images(size, "film.mp4")


def test_uneven_times_keep_their_pace(loaded, frontal_pose, tmp_path):
    images = [cv2.resize(image, (128, 96), interpolation=cv2.INTER_AREA) for image in film_frames()]
    path = write_images(tmp_path / "uneven.mkv", images, uneven=True)
    poses: list[np.ndarray | None] = [None] * FRAMES
    poses[FRAMES - 1] = frontal_pose
    drawing, _, found = drawn(path, loaded, poses)
    with Film(path) as film:
        times = [frame.time_s for frame in film]
    assert len(found) == round((times[-1] - times[0]) * drawing.fps) + 1
    assert drawing.counts["repeated"] + FRAMES - drawing.counts["left_out"] == len(found)
    # each frame is shown at its time
    for number in (0, FRAMES // 2, FRAMES - 2):
        shown = found[round((times[number] - times[0]) * drawing.fps)]
        assert int(np.argmin([distance(shown, image) for image in images[:-1]])) == number


def test_frames_of_a_distorted_lens_are_undistorted(loaded, frontal_pose, tmp_path):
    distortion = Distortion(-8.0, 30.0, 0.02, -0.03, 0.0)
    bent = replace(loaded, case=replace(loaded.case, distortion=distortion))
    images = film_frames()[:2]
    poses = [None, frontal_pose]
    _, _, found = drawn(write_film(tmp_path / "f.mkv", images), bent, poses)
    straight, _ = undistort(images[0] / np.float32(255), CAMERA, distortion)
    assert distance(found[0], 255 * straight) < 2
    assert distance(found[0], images[0]) > 2 * distance(found[0], 255 * straight)
