"""Members that a test registers, which no other test may know."""

from pidtsm_core.registration import FAMILIES


def forget() -> None:
    """Remove what this process has registered."""
    for family in FAMILIES:
        for name, origin in family.outside().items():
            if origin.serial:
                family.forget(name)
