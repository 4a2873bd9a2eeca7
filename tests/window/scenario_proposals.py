"""Frame, K and surface one by one, and a pose without one click on the surface: proposed, taken, refined, saved."""

import bpy

bpy.ops.preferences.addon_enable(module="bl_ext.user_default.oneframe")

import scenario_first_session as first_session
import scenario_parts as parts
from bl_ext.user_default.oneframe.move import proposals
from bl_ext.user_default.oneframe.pipeline.alignment.proposal import propose, template_search
from bl_ext.user_default.oneframe.pipeline.case.case_file import read_case
from bl_ext.user_default.oneframe.setup.alignment_record import pose_record

MOST_ACTIONS = 12


def scenario(user):
    actions = yield from parts.load_parts(user)
    scene, true = bpy.context.scene, read_case(user.case).cam_from_mesh
    # the right size alone and fewer poses: quicker
    template_search.SPANS, propose.REFINED = template_search.SPANS[-1:], (30, 5)
    yield from user.press("oneframe.propose_poses")
    yield from user.until(lambda: proposals.found(scene) is not None, "proposed poses")
    yield from user.redraw()
    yield from user.picture("1_proposed")
    yield from user.press("oneframe.take_proposal")
    yield from user.until(lambda: pose_record(scene)["method"] == "proposed", "the first of them")
    yield from user.redraw()
    user.facts["px proposed"] = parts.off_px(scene, true)
    yield from user.picture("2_taken")
    yield from first_session.refine(user)
    user.facts["px refined"] = parts.off_px(scene, true)
    yield from user.press("oneframe.save_case")
    yield from user.accept_file()
    actions += 6
    yield from user.until((user.folder / "case.toml").exists, "the case")
    user.facts["actions"] = actions
    assert actions <= MOST_ACTIONS
    assert parts.off_px(scene, true) < 1.0, user.facts
