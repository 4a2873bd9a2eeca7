"""The picture that a surgeon looks at: an image, the overlay of a case at a pose, its legend and a scale bar."""

import string
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..camera.pinhole import PinholeCamera, whereabouts
from ..case.loaded_case import LoadedCase, overlay_scene
from ..errors import InputError
from ..images.layer_stack import LayerStack, Seen
from ..images.legend import Entry, Place, ScaleBar, Write, freest_corner, legend_panel, put, scale_bar
from ..images.overlay import draw_overlay
from ..images.pixel_values import to_uint8

SOME = 0.01
"""Fraction of a structure that is worth mentioning."""


@dataclass(frozen=True)
class StructureView:
    """A structure in a picture.

    Attributes
    ----------
    name
        The structure's.
    seen
        How much of it is seen.
    place
        Where it lies if it is outside the frame, in words; else ``None``.
    """

    name: str
    seen: Seen
    place: str | None

    @property
    def note(self) -> str:
        """What is to say about it, in a few words."""
        if self.place is not None:
            return self.place
        if not self.seen.visible_px and not self.seen.hidden_px:
            return "covered"
        if self.visible_fraction > 1 - SOME:
            return "visible"
        if self.visible_fraction > SOME:
            return f"{100 * self.visible_fraction:.0f} % visible, to {self.seen.deepest_mm:.1f} mm deep"
        return f"{self.seen.shallowest_mm:.1f} to {self.seen.deepest_mm:.1f} mm deep"

    @property
    def visible_fraction(self) -> float:
        """The share of its pixels that the surface does not hide, 0..1; 0 if none are seen."""
        return self.seen.visible_px / max(self.seen.visible_px + self.seen.hidden_px, 1)


@dataclass(frozen=True)
class OverlayPicture:
    """A picture and what it shows.

    Attributes
    ----------
    image
        ``(H, W, 3)`` uint8.
    structures
        In the order of the case.
    bar
        The scale bar; ``None`` if neither surface nor structures are in view.
    shows_surface
        Whether the surface is in view.
    """

    image: np.ndarray
    structures: tuple[StructureView, ...]
    bar: ScaleBar | None
    shows_surface: bool


class OverlayPainter:
    """Paints the overlay of a case over images of one camera; legend and scale bar keep their corner."""

    def __init__(self, loaded: LoadedCase, camera: PinholeCamera, write: Write | None) -> None:
        """Prepare a case for images of a camera; ``write`` draws the letters of legend and scale bar, if it has any."""
        self._loaded, self._camera, self._scene, self._write = loaded, camera, overlay_scene(loaded), write
        self._place: Place | None = None
        if write is not None:
            # learns the letters: a film is painted while Blender, which draws them, encodes
            write(string.printable + "".join(structure.name for structure, _ in loaded.surface.structures), 1.0)

    def paint(
        self, image: np.ndarray, cam_from_model: np.ndarray, *, clear: np.ndarray | None = None, sure: bool = True
    ) -> OverlayPicture:
        """Paint over an image.

        Parameters
        ----------
        image
            ``(H, W, 3)`` uint8 of the camera.
        cam_from_model
            4x4, mm.
        clear
            ``(H, W)`` bool: where the overlay may cover the image; ``None`` for everywhere. Or the share, 0..1, of its
            opacity.
        sure
            Whether the legend may state how deep the structures lie.
        """
        camera, scene = self._camera, self._scene
        surface, layers = scene.surface_layer(camera, cam_from_model), scene.layers(camera, cam_from_model)
        stack = LayerStack.of(surface, layers)
        views = self._views(stack, cam_from_model)
        bar = self._bar(stack, surface.depth_mm)
        result = draw_overlay(image, surface, layers, stack, clear=clear)
        if self._write is not None and sure:
            self._explain(result, stack, views, bar, self._write)
        return OverlayPicture(result, views, bar, bool((surface.depth_mm > 0).any()))

    def _views(self, stack: LayerStack, cam_from_model: np.ndarray) -> tuple[StructureView, ...]:
        views = []
        for number, (structure, mesh) in enumerate(self._loaded.surface.structures):
            seen, place = stack.seen(number), None
            if not seen.visible_px and not seen.hidden_px:
                place = whereabouts(mesh.vertices, self._camera, cam_from_model)
            views.append(StructureView(structure.name, seen, place))
        return tuple(views)

    def _bar(self, stack: LayerStack, surface_depth_mm: np.ndarray) -> ScaleBar | None:
        """At the median depth of the structures that are seen or, without any, of the surface."""
        depth, what = stack.median_depth_mm, "structures"
        if depth is None:
            # every fourth pixel is enough for a median
            seen = surface_depth_mm[::4, ::4]
            seen = seen[seen > 0]
            if not len(seen):
                return None
            depth, what = float(np.median(seen)), "surface"
        return scale_bar(self._camera.fx / depth, self._camera.shape_hw, f"at the {what}, {depth:.0f} mm away")

    def _explain(
        self, image: np.ndarray, stack: LayerStack, views: Sequence[StructureView], bar: ScaleBar | None, write: Write
    ) -> None:
        shape = self._camera.shape_hw
        entries = [
            Entry(structure.colour, _spelt(view.name), view.note, is_dashed=view.visible_fraction < 0.5)
            for view, (structure, _) in zip(views, self._loaded.surface.structures, strict=True)
        ]
        panel = legend_panel(entries, bar, write, shape)
        # before anything is in view, no corner is better than another
        if panel is None or (self._place is None and bar is None):
            return
        if self._place is None:
            busy = np.zeros(shape, bool)
            x, y = stack.corner
            busy[y : y + stack.number.shape[0], x : x + stack.number.shape[1]] = stack.number >= 0
            self._place = freest_corner(busy, panel.shape[:2])
        put(image, panel, self._place)


def _spelt(name: str) -> str:
    """A name as it is read: file names have underscores."""
    return name.replace("_", " ")


def case_picture(loaded: LoadedCase, write: Write | None, *, under_instruments: bool = False) -> OverlayPicture:
    """The frame of a case with its overlay.

    Parameters
    ----------
    loaded
        The case, at its pose.
    write
        Draws the letters of legend and scale bar; ``None`` for neither.
    under_instruments
        Leave pixels of the frame with alpha 0 as they are.
    """
    painter = OverlayPainter(loaded, loaded.frame.camera, write)
    clear = loaded.frame.valid if under_instruments else None
    picture = painter.paint(to_uint8(loaded.frame.image), loaded.frame.cam_from_model, clear=clear)
    if not picture.shows_surface:
        raise InputError(
            f"{loaded.case.path.name}: expected the surface in the frame, it shows none of it; align first"
        )
    return picture


def picture_lines(loaded: LoadedCase, picture: OverlayPicture) -> list[str]:
    """What a picture shows, in lines."""
    lines = [f"{view.name}: {view.note}" for view in picture.structures]
    if not lines:
        lines.append("the case has no structures: only the surface is drawn")
    if picture.bar:
        lines.append(f"scale bar: {picture.bar.label}")
    if loaded.case.distortion:
        lines.append("the picture is the undistorted frame")
    return lines
