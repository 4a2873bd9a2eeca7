"""``dataset_info.md``: what a dataset's readers need to be told, with the dataset's own figures."""

from pathlib import Path

from ...camera.pinhole import PinholeCamera
from ...files.writing import write_bytes_atomically
from ...surface.mesh import TriangleMesh
from .. import layout
from ..layout import OBJECT_ID, SPLIT, scene_count

TEXT = """\
# {name}: {count} rendered views

One object, `obj_id` {object_id} ({name}), in {scenes} scene{s} of at most {per_scene} views, {width} x {height} px.
The layout is that of BOP. `dataset.json` holds what the dataset was made from.

- **Poses** (`cam_R_m2c`, `cam_t_m2c`) hold for the mesh in `models/`, in mm, with OpenCV axes.
- **Origin**: the mean of the vertices. BOP's own models have it in the centre of their 3D box, which is at
  ({centre}) mm here: `box_centre_mm` in `models_info.json`. No tool needs the two to be the same.
- **Symmetries**: none. **Occlusion**: {occlusion}; `visib_fract` is below 1 where the image cuts the surface.
- **Depth**: value x {depth_scale:g} = mm along the optical axis. A view that reaches farther has its own
  `depth_scale` in `scene_camera.json`.

## bop_toolkit

The split is `{split}` of type `{split_type}`. The toolkit knows datasets by name. Add these entries to its
`dataset_params.py`, with the name of this folder instead of `NAME`:

```python
# get_model_params: obj_ids, symmetric_obj_ids
"NAME": [{object_id}],
"NAME": [],

# get_split_params
elif dataset_name == "NAME":
    p["scene_ids"] = list(range({scenes}))
    p["im_size"] = ({width}, {height})
```

`test_targets_bop19.json` names the views that show at least 10 % of the surface, and `models_eval/` is for errors of
poses.

## Nerfstudio

```sh
ns-train depth-nerfacto --data . nerfstudio-data --depth-unit-scale-factor {depth_scale:g} --center-method focus
```

By default Nerfstudio takes a unit of depth for a thousandth of a unit of the poses, and centres the scene among the
cameras. It trains on the white pixels of the masks, which are those with surface. It has one scale for all depths:
leave out views with their own.

## Instant NGP

It needs no options: `scale` and `offset` in `transforms.json` put the surface in its unit cube.
"""


OCCLUDED = "instruments in front of the surface, `mask_occluder`; `mask` and `px_count_all` are as without them"


def write_dataset_info(
    root: Path,
    object_name: str,
    count: int,
    camera: PinholeCamera,
    mesh: TriangleMesh,
    depth_scale: float,
    *,
    occluded: bool = False,
) -> None:
    """Write ``dataset_info.md``.

    Parameters
    ----------
    object_name, count, camera
        Name of the surface, number and intrinsics of the views.
    mesh
        The surface in the model frame, mm.
    depth_scale
        Millimetres per unit of the depth images.
    occluded
        Whether something stands in front of the surface.
    """
    split, split_type = SPLIT.split("_")
    scenes = scene_count(count)
    text = TEXT.format(
        name=object_name,
        count=count,
        scenes=scenes,
        s="s" * (scenes > 1),
        object_id=OBJECT_ID,
        per_scene=layout.VIEWS_PER_SCENE,
        width=camera.width,
        height=camera.height,
        centre=", ".join(f"{value:.3f}" for value in mesh.bounds.mean(axis=0)),
        depth_scale=depth_scale,
        occlusion=OCCLUDED if occluded else "none",
        split=split,
        split_type=split_type,
    )
    write_bytes_atomically(root / "dataset_info.md", text.encode())
