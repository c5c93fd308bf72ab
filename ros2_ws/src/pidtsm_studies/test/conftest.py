"""A browser for the tests of the pages."""

from collections.abc import Iterator

import pytest
from support.devtools import Page, browser


@pytest.fixture(scope="session")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """The page of a headless Chromium; tests that use it are skipped without Chromium."""
    with browser(tmp_path_factory.mktemp("browser") / "profile") as page:
        yield page
