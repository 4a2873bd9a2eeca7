"""The tables of a dataset: BOP's, COCO's, NeRF's and CSV, made from the records of its views."""
