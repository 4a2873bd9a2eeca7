"""Questions before something of the user's is lost. Return cancels, as the safe answer."""

import json
import textwrap

import bpy
from bpy.props import StringProperty

from ..class_registration import prop
from .operator import Messages, OperatorResult, Reporting, call
from .panel import CHARACTER_PX

DIALOG_PX = 400
"""Width of a question, at scale 1."""


class Asking(Reporting):
    """Mixin: asks before something of the user's is lost."""

    _question = ""

    def ask(self, context: bpy.types.Context, title: str, question: str, answer: str) -> OperatorResult:
        """Open the question; the button ``answer`` runs the operator. For ``invoke`` to return."""
        self._question = question
        # invoke_confirm has no safe default
        return context.window_manager.invoke_props_dialog(
            self, width=DIALOG_PX, title=title, confirm_text=answer, cancel_default=True
        )

    def draw(self, context: bpy.types.Context) -> None:
        column = self.layout.column(align=True)
        for number, line in enumerate(textwrap.wrap(self._question, int(DIALOG_PX / CHARACTER_PX) - 8)):
            column.label(text=line, icon="BLANK1" if number else "ERROR")

    def execute(self, context: bpy.types.Context) -> OperatorResult:
        self._question = ""  # it is answered: Adjust Last Operation would show it again
        return super().execute(context)


class ONEFRAME_OT_ask(Asking):
    """Ask whether another operator goes on"""

    bl_label = "Ask"
    bl_options = {"INTERNAL"}

    texts: str = prop(StringProperty, description="Title, question, answer (JSON)", options={"SKIP_SAVE", "HIDDEN"})
    command: str = prop(
        StringProperty, description="Operator, context, settings (JSON)", options={"SKIP_SAVE", "HIDDEN"}
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return not bpy.app.background

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> OperatorResult:
        return self.ask(context, *json.loads(self.texts))

    def run(self, context: bpy.types.Context) -> Messages:
        name, way, settings = json.loads(self.command)
        call(name, way, undo=True, **settings)
        return ()


def ask_first(texts: tuple[str, str, str], name: str, context: str = "INVOKE_DEFAULT", **settings: object) -> None:
    """Ask with a title, a question and an answer, whose button runs an operator; see :func:`.call`.

    An operator of its own asks: a file dialog would show what its operator draws.
    """
    call("ask", "INVOKE_DEFAULT", texts=json.dumps(texts), command=json.dumps([name, context, settings]))
