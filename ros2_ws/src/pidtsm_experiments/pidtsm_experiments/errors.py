"""Errors that end a command with one line instead of a traceback."""

import errno

OF_THE_DISK = {
    *(errno.ENOSPC, errno.EDQUOT, errno.EFBIG),
    *(errno.EIO, errno.EROFS, errno.ENXIO, errno.ENODEV, errno.ESTALE),
}
"""Numbers of errors of a disk that is full or gone."""


class RunError(RuntimeError):
    """The work failed: exit code 1."""
