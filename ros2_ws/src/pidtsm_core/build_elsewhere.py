"""Build backend of pip: setuptools in a copy of this folder, because it leaves build/ and *.egg-info where it runs."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from setuptools import build_meta


@contextmanager
def _copy() -> Iterator[None]:
    """Work in a copy of the current folder."""
    source = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder, source.name)
        shutil.copytree(source, copy, ignore=shutil.ignore_patterns("build", "test", "*.egg-info", "__pycache__"))
        os.chdir(copy)
        try:
            yield
        finally:
            os.chdir(source)


def build_wheel(wheel_directory: str, config_settings: Any = None, _metadata_directory: str | None = None) -> str:
    """See PEP 517; likewise `build_sdist`."""
    target = str(Path(wheel_directory).resolve())
    with _copy():
        return str(build_meta.build_wheel(target, config_settings))


def build_sdist(sdist_directory: str, config_settings: Any = None) -> str:
    """See `build_wheel`."""
    target = str(Path(sdist_directory).resolve())
    with _copy():
        return str(build_meta.build_sdist(target, config_settings))
