"""The article's claims about its evaluation (section 4), read from claims.yaml."""

from importlib.resources import files
from typing import Any

import yaml

PRINTED: dict[str, Any] = yaml.safe_load((files(__package__) / "claims.yaml").read_text(encoding="utf-8"))
"""Content of the file: two values of the article used by claims, the reasons by name, and the claims."""
