"""What goes wrong with bags."""


class RecordingError(ValueError):
    """A bag cannot be read, or is not of a run; the message says why and what to do."""


class UnfinishedBag(UserWarning):
    """What was read comes from a bag that was never finished; the message says what is missing."""


def damaged(what: str, error: Exception) -> RecordingError:
    """The error that says what is damaged, why, and how to save the rest."""
    cause = str(error) or type(error).__name__
    return RecordingError(f"{what}: {cause} (`mcap recover FILE.mcap -o SAVED.mcap` saves the rest of an MCAP file)")
