"""Before a run: what the drive's torque demand means, found and from then on read that way."""

from __future__ import annotations

from autotune.core.errors import DriveError
from autotune.experiments.torque_semantics import TORQUE_STEP, Meaning, TorqueSemantics, TorqueStep
from autotune.tuning.session import Session

INCLUDES = "torque.demand_includes_feedforward"


def must_be_found(session: Session) -> bool:
    """True where the profile leaves it open whether the demand includes the torque offset."""
    return INCLUDES in session.loop.read_parameters()


def torque_semantics(session: Session) -> TorqueSemantics:
    """Plays the step; the axis holds where it stands."""
    _, played = session.play(TORQUE_STEP, [TorqueStep(session.motion)])
    found = played.result(TORQUE_STEP)
    if not isinstance(found, TorqueSemantics):
        raise DriveError("the torque step gave no result; run again")
    return found


def find_torque_semantics(session: Session) -> str:
    """Finds the meaning, reads the drive accordingly from now on, and says so.

    Raises:
        DriveError: it cannot be told, or contradicts a profile that says it.
    """
    found = torque_semantics(session)
    meaning = found.require()
    if not must_be_found(session):
        if meaning is not Meaning.INCLUDED:
            raise DriveError(contradiction(found))
        return "the torque demand is as the profile says"
    assumed = bool(session.loop.read_parameters([INCLUDES])[INCLUDES])
    includes = assumed if meaning is Meaning.INCLUDED else not assumed
    if meaning is (Meaning.TWICE if assumed else Meaning.MISSING):
        raise DriveError(contradiction(found))
    session.loop.write_parameters({INCLUDES: float(includes)})
    how = "includes" if includes else "does not include"
    return f"found by a small step: this drive's torque demand {how} the torque offset"


def contradiction(found: TorqueSemantics) -> str:
    """Why the profile cannot be right."""
    return (
        f"the torque offset is {found.meaning.value} in the torque demand as the profile reads it "
        f"({found.reason}); correct torque.demand_includes_feedforward or the units in the profile"
    )
