"""The dataset and the pack of the tests of packing."""

from tests.packing.conftest import copied, copied_pack, dataset, packed  # noqa: F401
