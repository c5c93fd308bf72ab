"""Arrays as text of a page."""

import base64

from pidtsm_core.arrays import Array


def packed(values: Array) -> str:
    """Numbers of any shape as little-endian float32 in base64, row after row; read by page.js."""
    return base64.b64encode(values.astype("<f4").tobytes()).decode()
