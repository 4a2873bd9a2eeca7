"""``dataset_info.md`` of a pack: what its readers need to know, with its own figures."""

from ..dataset.dataset_file import Description
from ..dataset.layout import OBJECT_ID
from ..dataset.run.survey import view_ranges
from ..dataset.truths import TRUTHS
from .layout import FILES, MASKS, member_suffixes
from .manifest import Plan

_MEANING = {
    "camera.json": "`cam_K`, `depth_scale`, world-to-camera pose",
    "gt.json": "`cam_R_m2c` (row by row), `cam_t_m2c` in mm, `obj_id`",
    "gt_info.json": "boxes (x, y, width, height), pixel counts, visible fraction",
    **{f"{kind}.json": f"{TRUTHS[kind].about}, as uncompressed run lengths (RLE)" for kind in MASKS},
    **{name: f"{TRUTHS[kind].form.about}; {TRUTHS[kind].about}" for kind, name in FILES.items()},
    "rgb.png": "8 bit, as rendered",
    "rgb.jpg": "8 bit, compressed",
}

TEXT = """\
# {name}: {count} rendered views, packed

One object, `obj_id` {object_id} ({name}), {width} x {height} px. {shards} WebDataset shard{s} of at most {per_shard}
views, which are views {views} of the dataset. The layout is BOP's image-wise one. Poses hold for the mesh in `models/`,
in mm, with OpenCV axes. No symmetries, {occlusion}. `dataset.json` holds what the dataset was made from, `pack.json`
the views and the SHA-256 of each shard, `key_to_shard.json` the shard of each key.
{about}
A view's key is `SSSSSS_IIIIII`, scene and image of the dataset (view = 1000 x scene + image). Its members:

| after the key and a dot | |
|---|---|
{members}

{rgb}

## Reading it

```python
import webdataset as wds

shards = "shard-{{000000..{last:06d}}}.tar"
for sample in wds.WebDataset(shards, shardshuffle=False).decode("rgb8"):
    rgb, truth = sample["{rgb_name}"], sample["gt.json"][0]
```

bop_toolkit: `bop_webdataset.load_image_data("shard-000000.tar", key, rgb_suffix="{rgb_suffix}")`.

OneFrame: `from oneframe.reader import open_dataset; open_dataset(".")[0].depth_mm`; `oneframe pack --verify --out .`
compares all hashes.
"""


def pack_info(description: Description, plan: Plan, about: str = "") -> bytes:
    """The content of the file, with one more paragraph if there is something to say about the choice of views."""
    jpeg = plan.jpeg_quality is not None
    suffixes = member_suffixes(description.kinds, jpeg=jpeg)
    rgb = f"RGB is JPEG of quality {plan.jpeg_quality}." if jpeg else "RGB is as it was rendered."
    return TEXT.format(
        about=f"\n{about}\n" if about else "",
        name=description.name,
        count=len(plan.views),
        object_id=OBJECT_ID,
        width=description.camera.width,
        height=description.camera.height,
        shards=len(plan.shards()),
        s="s" * (len(plan.shards()) > 1),
        per_shard=plan.views_per_shard,
        views=view_ranges(plan.views),
        members="\n".join(f"| `{suffix}` | {_MEANING[suffix]} |" for suffix in suffixes),
        occlusion="instruments in front of the surface" if "mask_occluder" in description.kinds else "no occlusion",
        rgb=rgb,
        last=len(plan.shards()) - 1,
        rgb_name="rgb.jpg" if jpeg else "rgb.png",
        rgb_suffix=".jpg" if jpeg else ".png",
    ).encode()
