"""Members of the families from outside: laws, surfaces and others that this package does not contain.

`register` adds one in the running process. Installed packages offer theirs as entry points, which every process finds::

    [project.entry-points."pidtsm.laws"]
    my_law = "my_package.my_law:MY_LAW"

The groups are ``pidtsm.laws``, ``pidtsm.surfaces``, ``pidtsm.reaching``, ``pidtsm.estimators``, ``pidtsm.references``,
``pidtsm.disturbances`` and ``pidtsm.robots``. An entry point may also be an iterable of members.
"""

import uuid
from typing import Any

from pidtsm_core.errors import MemberError
from pidtsm_core.estimators import ESTIMATORS
from pidtsm_core.laws import LAWS
from pidtsm_core.laws.reaching import REACHING_LAWS
from pidtsm_core.laws.surfaces import SURFACES
from pidtsm_core.parameters.family import Family, Origin
from pidtsm_core.references import REFERENCES
from pidtsm_core.robots import ROBOTS
from pidtsm_core.simulation.disturbances import DISTURBANCES

FAMILIES: tuple[Family[Any], ...] = (
    SURFACES,
    REACHING_LAWS,
    LAWS,
    ESTIMATORS,
    REFERENCES,
    DISTURBANCES,
    ROBOTS,
)
"""In an order in which each comes after those of which its members consist."""


def register(*members: Any) -> None:
    """Make laws, surfaces, reaching laws, estimators, references, disturbances or robots known by their names.

    From then on they are allowed wherever those of this package are: in rollouts, batches (their workers included),
    scores, searches, and in nodes that this process contains. A member is compiled at once, and tried with its default
    parameters. In a notebook, a cell can be run again: a member of the same name replaces the one before.

    Args:
        members: of type `Law`, `Surface`, `ReachingLaw`, `Estimator`, `Reference`, `Disturbance` or `Robot`. What they
            consist of, such as the surface of a law, comes before them.

    Raises:
        MemberError: a member is none of these, its name is taken, it does not compile, or it returns nonsense. The
            members before it stay registered.
    """
    for member in members:
        family_of(member).replace(member, Origin("this process", uuid.uuid4().hex))


def family_of(member: Any) -> Family[Any]:
    """The family to which a member belongs.

    Raises:
        MemberError: it is a member of none.
    """
    for family in FAMILIES:
        if isinstance(member, family.kind):
            return family
    kinds = ", ".join(family.kind.__name__ for family in FAMILIES)
    raise MemberError(f"{member!r} cannot be registered: it must be one of {kinds}")
