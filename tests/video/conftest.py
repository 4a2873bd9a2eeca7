"""Pictures of the sample case to make films of."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from oneframe.colour.ray_tracer import RayTracer
from oneframe.colour.shading import ColouredSurface
from oneframe.colour.vertex_colours import VertexColours
from oneframe.images.pixel_values import to_uint8
from oneframe.sample.temporal_bone import MICROSCOPE, frame_pose, held_out_poses, sample_surface
from oneframe.video import decoder

SIZE_WH = (240, 180)


@pytest.fixture
def decoded_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Films are decoded in this process: a process for each takes longer than its film."""

    def parts(path: Path, *arguments: object) -> Iterator[bytes]:
        return (part for part in decoder.film(path, *arguments) if part)

    monkeypatch.setattr("oneframe.video.film_reader.decoded_apart", parts)


@pytest.fixture(scope="session")
def painted_bone() -> RayTracer:
    """Shows the sample's bone, painted with waves, at any pose; without light."""
    rng, mesh = np.random.default_rng(20), sample_surface(spacing_mm=0.8).bone
    waves = rng.normal(size=(60, 3))
    paint = np.cos(mesh.vertices @ waves.T + rng.uniform(0, 2 * np.pi, 60)).sum(axis=1) / 8
    rgb = np.clip(np.array([0.8, 0.65, 0.5]) * (1 + 0.3 * np.minimum(paint, 0.6)[:, None]), 0, 1).astype(np.float32)
    everywhere = np.ones(len(rgb), bool)
    return RayTracer(
        ColouredSurface(mesh, (VertexColours(rgb, everywhere, everywhere),), rgb), MICROSCOPE.resized(*SIZE_WH)
    )


@pytest.fixture(scope="session")
def sample_views(painted_bone: RayTracer) -> list[np.ndarray]:
    """Two views of the sample's bone, of size :data:`SIZE_WH`, uint8 RGB, with detail down to the pixel."""
    grain = 0.12 * np.random.default_rng(21).normal(size=(*SIZE_WH[::-1], 1))
    return [to_uint8(painted_bone.render(pose).rgb + grain) for pose in (frame_pose(), held_out_poses()[3])]
