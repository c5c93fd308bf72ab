"""Errors and warnings about bags."""


class RecordingError(ValueError):
    """A bag cannot be read, or does not contain a run; the message contains the reason and a remedy."""


class UnfinishedBag(UserWarning):
    """The bag was not finished; the message contains what is missing."""


def damaged(what: str, error: Exception) -> RecordingError:
    """Error with the damaged part, the reason in one line, and how to recover the rest."""
    cause = " ".join(str(error).split()) or type(error).__name__
    return RecordingError(f"{what}: {cause} (`mcap recover FILE.mcap -o SAVED.mcap` recovers the rest of an MCAP file)")
