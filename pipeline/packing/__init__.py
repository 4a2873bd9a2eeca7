"""A dataset packed for training: WebDataset tar shards in BOP's image-wise layout, and the proof that they are whole.

In: the folder of a dataset and an ordered list of its views. Out: a folder that needs no other, byte for byte the same
whoever packs it.
"""
