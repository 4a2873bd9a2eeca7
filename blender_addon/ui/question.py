"""The question before something of the user's is lost. Return cancels, as the safe answer."""

import json
import textwrap

import bpy
from bpy.props import StringProperty

from ..class_registration import prop
from .operator import Messages, OperatorResult, Reporting, call
from .panel import CHARACTER_PX

DIALOG_PX = 400
"""Width of a question, at scale 1."""


class ONEFRAME_OT_ask(Reporting):
    """Ask whether another operator goes on"""

    bl_label = "Ask"
    bl_options = {"INTERNAL"}

    title: str = prop(StringProperty, options={"SKIP_SAVE", "HIDDEN"})
    question: str = prop(StringProperty, options={"SKIP_SAVE", "HIDDEN"})
    answer: str = prop(StringProperty, options={"SKIP_SAVE", "HIDDEN"})
    command: str = prop(
        StringProperty, description="Operator, context, settings (JSON)", options={"SKIP_SAVE", "HIDDEN"}
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return not bpy.app.background

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        # invoke_confirm has no safe default
        return context.window_manager.invoke_props_dialog(
            self, width=DIALOG_PX, title=self.title, confirm_text=self.answer, cancel_default=True
        )

    def draw(self, context: bpy.types.Context) -> None:
        column = self.layout.column(align=True)
        for number, line in enumerate(textwrap.wrap(self.question, int(DIALOG_PX / CHARACTER_PX) - 8)):
            column.label(text=line, icon="BLANK1" if number else "ERROR")

    def run(self, context: bpy.types.Context) -> Messages:
        name, way, settings = json.loads(self.command)
        call(name, way, undo=True, **settings)
        return ()


def ask_first(texts: tuple[str, str, str], name: str, context: str = "EXEC_DEFAULT", **settings: object) -> None:
    """Ask with a title, a question and an answer, whose button runs an operator; see :func:`.call`."""
    title, question, answer = texts
    command = json.dumps([name, context, settings])
    call("ask", "INVOKE_DEFAULT", title=title, question=question, answer=answer, command=command)
