"""The commands that users run: ``oneframe COMMAND``, and the scripts that run the same code.

In: a command line. Out: files, messages on standard output, an exit code. A command reads its inputs, calls one
function of the pipeline and reports the result. It checks its arguments before it imports Blender and OpenCV.
"""
