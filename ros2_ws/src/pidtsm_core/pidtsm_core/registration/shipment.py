"""Members that were registered in this process, on their way to the workers of a batch."""

import threading
from typing import Any, NamedTuple

from pidtsm_core.errors import MemberError
from pidtsm_core.parameters.family import Origin
from pidtsm_core.registration import FAMILIES, family_of

_unpacking = threading.Lock()


class Parcel(NamedTuple):
    """A member in the form in which processes exchange it."""

    family: str
    name: str
    origin: Origin
    content: bytes


def packed() -> tuple[Parcel, ...]:
    """The members that were registered in this process; those of installed packages, every process finds itself.

    Raises:
        MemberError: a member cannot be sent to another process.
    """
    parcels = []
    for family in FAMILIES:
        for name, origin in family.outside().items():
            if origin.serial:
                parcels.append(Parcel(family.title, name, origin, _packed(family[name])))
    return tuple(parcels)


def _packed(member: Any) -> bytes:
    import cloudpickle  # Needed only where a process has registered members.

    try:
        content: bytes = cloudpickle.dumps(member)
    except Exception as reason:  # Whatever its parts raise.
        raise MemberError(f"{member.name} cannot be sent to the workers: {reason}") from None
    return content


def unpack(parcels: tuple[Parcel, ...]) -> None:
    """Register members in this process, unless it has them.

    Raises:
        MemberError: a module that they use does not exist here, or see `register`.
    """
    if not parcels:
        return
    import cloudpickle

    families = {family.title: family for family in FAMILIES}
    for parcel in parcels:
        with _unpacking:
            if families[parcel.family].outside().get(parcel.name) == parcel.origin:
                continue
            try:
                member = cloudpickle.loads(parcel.content)
            except ImportError as reason:
                raise MemberError(f"{parcel.name}: a worker cannot import what it uses: {reason}") from None
            family_of(member).replace(member, parcel.origin)
