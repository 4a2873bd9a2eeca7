"""Views on disk.

In: rendered views. Out: a folder in the BOP layout with COCO, NeRF and CSV tables; ``check`` verifies that it is
complete and consistent.
"""
