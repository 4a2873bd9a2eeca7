"""Films are decoded in the test's process, as in tests/video."""

import pytest

from tests.video.conftest import decoded_here  # noqa: F401


@pytest.fixture(autouse=True)
def films_decoded_here(decoded_here):  # noqa: F811
    """A process for each film takes longer than its frames."""
