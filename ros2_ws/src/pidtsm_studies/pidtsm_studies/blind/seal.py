"""Truth in a file that nobody reads by accident."""

import base64
import binascii
import json
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pidtsm_core.errors import UsageError
from pidtsm_studies.blind.faults import Planted
from pidtsm_studies.diagnosis.causes import NAMES

SEALED = "truth.sealed"
"""Name of the file."""
_HEAD = "The truth about a blind arm, sealed; the report of ./pidtsm diagnose opens it at its end.\n"


def seal(truth: Sequence[Planted], folder: Path) -> None:
    """Write the faults of a blind arm to `SEALED` in a folder."""
    plain = [
        {"cause": each.cause.value, "name": NAMES[each.cause], "joints": list(each.joints), "text": each.text}
        for each in truth
    ]
    packed = base64.b64encode(zlib.compress(json.dumps(plain).encode())).decode()
    (folder / SEALED).write_text(f"{_HEAD}{packed}\n", encoding="utf-8")


def opened(folder: Path) -> list[dict[str, Any]] | None:
    """The faults in a folder, each with ``cause``, ``name``, ``joints`` and ``text``; None: there is no sealed file.

    Raises:
        UsageError: it is damaged.
    """
    file = folder / SEALED
    if not file.is_file():
        return None
    try:
        packed = file.read_text(encoding="utf-8").removeprefix(_HEAD)
        faults = json.loads(zlib.decompress(base64.b64decode(packed, validate=False)))
        return [{key: each[key] for key in ("cause", "name", "joints", "text")} for each in faults]
    except (ValueError, KeyError, TypeError, UnicodeDecodeError, binascii.Error, zlib.error):
        raise UsageError(f"{file}: the sealed truth is damaged; make the blind arm again") from None
