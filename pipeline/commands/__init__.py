"""What users call: ``oneframe COMMAND``, and the scripts of the same names.

In: a command line. Out: files, sentences on the standard output, an exit code. A command gathers its inputs, calls one
function of the pipeline and reports; Blender and OpenCV are imported once its arguments are right.
"""
