"""A browser for the tests of the pages."""

from collections.abc import Iterator

import pytest
from devtools import Page, browser


@pytest.fixture(scope="session")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """The one page of a headless Chromium; for tests that are skipped where there is none."""
    with browser(tmp_path_factory.mktemp("browser") / "profile") as page:
        yield page
