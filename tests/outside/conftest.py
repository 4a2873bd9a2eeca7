"""Datasets and options that several harnesses share."""

from tests.outside.foreign_datasets import dataset, ray_cast_dataset, rendered_dataset  # noqa: F401
