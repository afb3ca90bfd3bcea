"""What a session changes in a moteus's parameters, how it is put back, and how ours are stored.

`conf write` stores everything as it is now, so what the session has set is put back before it. Where the
profile allows to load, nothing but our parameters is stored: what was stored before is loaded, ours are put
over it, written, loaded again to see that they are kept, and what was in force is given back.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from autotune.core.errors import ConfigurationError, DriveError, LinkError, TransferAborted
from autotune_drivers.kept import Keeper
from autotune_drivers.moteus.console import Console
from autotune_drivers.moteus.node import MoteusNode
from autotune_drivers.moteus.parameters import MoteusParameters
from autotune_drivers.moteus.profile import MoteusProfile

_OURS = ("controller.", "feedforward.")
_DIGITS, _DECIMALS = 1e-5, 1e-6  # relative and absolute, of a number that a console prints


class MoteusSettings:
    """Parameters of one controller, by its own names and by ours.

    Args:
        inherited: what an earlier session has left changed, name → old text.
        keeper: has on disk what may be changed at any moment.
    """

    def __init__(
        self,
        node: MoteusNode,
        profile: MoteusProfile,
        direction: int,
        inherited: Mapping[str, str] | None = None,
        keeper: Keeper | None = None,
    ) -> None:
        self.node = node
        self.console = Console(node)
        self.parameters = MoteusParameters(self.console, profile, direction)
        self._profile = profile
        self._before: dict[str, str] = dict(inherited or {})
        self._changed: set[str] = set(self._before)
        self._wanted: dict[str, str] = {}
        self._keeper = keeper
        self._kept: dict[str, tuple[str, ...]] = {}

    def backup(self) -> Mapping[str, str]:
        """Everything that was looked at in order to be changed, as it was before."""
        return dict(self._before)

    def note(self, *names: str) -> None:
        """Notes what will be changed. Raises LinkError."""
        for name in names:
            if name not in self._before:
                self._before[name] = self.console.get(name)

    def change(self, name: str, value: str) -> bool:
        """Changes a setting for the session; False where the controller does not have it.

        Raises:
            LinkError. ConfigurationError: it cannot be noted.
        """
        try:
            self.note(name)
        except TransferAborted:
            return False
        self._keep(name, value)
        self._changed.add(name)
        self._wanted[name] = value
        self.console.set(name, value)
        return True

    def restore(self) -> list[str]:
        """Puts everything back, last change first; says what could not be.

        The patience with a bad line begins anew, and when it ends, the rest is left to the next start, by name.
        """
        troubles: list[str] = []
        self.node.be_patient()
        left = [name for name in self._before if name in self._changed]
        for name in reversed(left):
            try:
                self.console.set(name, self._before[name])
                self._changed.discard(name)
            except TransferAborted as error:
                troubles.append(f"{name} could not be set back to {self._before[name]}: {error}")
            except LinkError as error:
                rest = ", ".join(left[: left.index(name) + 1])
                later = "" if self._keeper is None else ". The next start puts them right"
                return [*troubles, f"{rest} could not be set back: {error}{later}"]
        if not troubles:
            self._let_go()
        return troubles

    def _keep(self, name: str, value: str) -> None:
        """Notes a value that will be written. Raises ConfigurationError."""
        known = self._kept.get(name, ())
        if self._keeper is None or value in known:
            return
        kept = {**self._kept, name: (*known, value)}
        self._keeper.write(
            {
                "settings": [
                    {"name": one, "before": self._before[one], "written": list(written)}
                    for one, written in kept.items()
                ]
            }
        )
        self._kept = kept

    def _let_go(self) -> None:
        """Nothing is changed any more."""
        if self._keeper is not None and self._kept:
            self._keeper.clear()
        self._kept = {}

    # Storing

    def store(self) -> None:
        """Makes our parameters survive power-off.

        Raises:
            DriveError: the profile does not say how, or the memory does not keep them. LinkError.
        """
        store = self._profile.store
        if store is None:
            raise DriveError(
                f"profile {self._profile.name!r} does not say how this controller stores parameters; store them "
                "with 'conf write' in its console"
            )
        if not store.reload:
            self._store_as_it_is(store.seconds)
            return
        before = self.console.enumerate()
        ours = self._ours(before)
        try:
            self.console.load()
            for name, text in ours.items():
                self.console.set(name, text)
            self.console.write(store.seconds)
            self.console.load()
            self._verify(ours)
        finally:
            self._give_back(before)

    def _store_as_it_is(self, seconds: float) -> None:
        troubles = self.restore()
        if troubles:
            raise LinkError(
                f"nothing was stored in controller {self.node.number}, as {'; '.join(troubles)} first"
            )
        try:
            self.console.write(seconds)
        finally:
            for name, value in self._wanted.items():
                self.change(name, value)

    def _ours(self, before: Mapping[str, str]) -> dict[str, str]:
        places = self.parameters.places_of(_OURS)
        missing = [at for at in places if at not in before]
        if missing:
            raise ConfigurationError(
                f"controller {self.node.number} does not list {', '.join(missing)}; nothing was stored. Check its "
                "firmware against the profile"
            )
        return {at: before[at] for at in places}

    def _verify(self, ours: Mapping[str, str]) -> None:
        kept = self.console.enumerate()
        lost = [
            f"{name} is {kept.get(name)} instead of {text}"
            for name, text in ours.items()
            if kept.get(name) != text
        ]
        if lost:
            raise DriveError(
                f"controller {self.node.number} has confirmed storing, but {'; '.join(lost)}: its memory does not "
                "keep what is stored. Nothing is kept; have the controller's memory checked"
            )

    def _give_back(self, before: Mapping[str, str]) -> None:
        """The working values as they were, each that differs now."""
        now = self.console.enumerate()
        for name, text in before.items():
            if now.get(name) != text:
                self.console.set(name, text)


def put_right(console: Console, keeper: Keeper) -> tuple[str, ...]:
    """What an earlier session has left in this controller is put back, read back, and said.

    Only what holds a value of that session: what holds something else was set by somebody since.

    Raises:
        ConfigurationError: its file is damaged. LinkError: something could not be put back; the file stays.
    """
    content = keeper.read()
    if content is None:
        return tuple(keeper.others())
    try:
        left = [
            (str(one["name"]), str(one["before"]), [str(value) for value in one["written"]])
            for one in content["settings"]
        ]
    except (KeyError, TypeError) as error:
        raise keeper.damaged(error) from error
    put, foreign = [], []
    for name, before, written in reversed(left):
        present = console.get(name)
        if _alike(present, before):
            continue
        if not any(_alike(present, value) for value in written):
            foreign.append(name)
            continue
        console.set(name, before)
        if not _alike(found := console.get(name), before):
            raise LinkError(
                f"an earlier session has left {name} changed, and it could not be put back: it is {found} instead of "
                f"{before}. Switch the controller off and on, and start again"
            )
        put.append(name)
    keeper.clear()
    told = (
        [f"an earlier session has ended without closing; it left {', '.join(put)} changed; put back"]
        if put
        else []
    )
    if foreign:
        told.append(
            f"an earlier session has changed {', '.join(foreign)}, which hold something else again: left as they are"
        )
    return (*told, *keeper.others())


def _alike(one: str, other: str) -> bool:
    """The same text, or the same number: a console prints six digits, or six decimals, of what it was told."""
    try:
        return (
            one == other
            or math.isclose(float(one), float(other), rel_tol=_DIGITS, abs_tol=_DECIMALS)
            or one.lower() == other.lower()
        )
    except ValueError:
        return False
