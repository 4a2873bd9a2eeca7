"""One case: a frame, K, the surface, a pose, structures and landmarks.

In: a case file. Out: :class:`~.case_file.Case` and :class:`~.loaded_case.LoadedCase`, which all stages after it take.
"""
