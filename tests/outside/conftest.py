"""Datasets and options that several harnesses share."""

from tests.outside.foreign_datasets import awkward_case, dataset, ray_cast_dataset, rendered_dataset  # noqa: F401
