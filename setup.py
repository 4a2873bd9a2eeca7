"""The packages of ``oneframe``, which lie in the folder ``pipeline``; everything else stands in pyproject.toml."""

from setuptools import find_packages, setup

setup(packages=["oneframe", *(f"oneframe.{name}" for name in find_packages("pipeline"))])
