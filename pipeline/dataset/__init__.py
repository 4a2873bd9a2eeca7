"""Views on disk.

In: rendered views. Out: a folder in the BOP layout with COCO, NeRF and CSV tables, and the proof that it is whole
(``check``).
"""
