"""What a node or the page refuses to do."""


class RefusedError(RuntimeError):
    """An action has no effect; the message is the reason, in the words of who refused it."""
