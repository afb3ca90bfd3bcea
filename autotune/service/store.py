"""The history as the service uses it: every method is one transaction, confirmed when it returns."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import Engine, Table, delete, func, insert, select, update
from sqlalchemy.exc import IntegrityError

from autotune.service.tables import checks, events, jobs, parameters, permissions, proposals, runs

Row = dict[str, Any]
OPEN_STATES = ("queued", "running")


def text(moment: datetime) -> str:
    """A time as it is stored: UTC, whole seconds."""
    return moment.astimezone(UTC).isoformat(timespec="seconds")


def moment(stored: str) -> datetime:
    """A stored time."""
    return datetime.fromisoformat(stored)


class Store:
    """Queries on one database; safe to use from several threads."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self.additions = 0  # checks, runs and events that have been added through this object

    def close(self) -> None:
        """Lets go of the database."""
        self._engine.dispose()

    # Jobs

    def add_job(self, values: Mapping[str, Any]) -> bool:
        """Adds a job; False where one of that axis, kind and due time is there already."""
        try:
            with self._engine.begin() as connection:
                connection.execute(insert(jobs).values(**values))
        except IntegrityError:
            return False
        return True

    def change_job(self, identifier: str, **values: Any) -> None:
        """Changes fields of a job."""
        with self._engine.begin() as connection:
            connection.execute(update(jobs).where(jobs.c.id == identifier).values(**values))

    def job(self, identifier: str) -> Row | None:
        """A job by its id."""
        return self._one(select(jobs).where(jobs.c.id == identifier))

    def jobs_in(self, *states: str) -> list[Row]:
        """Jobs in these states, oldest first."""
        query = select(jobs).where(jobs.c.state.in_(states)).order_by(jobs.c.created, jobs.c.id)
        return self._all(query)

    def list_jobs(self, axis: str | None = None, state: str | None = None, limit: int = 50) -> list[Row]:
        """Newest jobs first."""
        query = select(jobs).order_by(jobs.c.created.desc(), jobs.c.id.desc()).limit(limit)
        if axis is not None:
            query = query.where(jobs.c.axis == axis)
        if state is not None:
            query = query.where(jobs.c.state == state)
        return self._all(query)

    def last_job(self, axis: str, kind: str, origin: str | None = None) -> Row | None:
        """The newest job of a kind on an axis."""
        query = select(jobs).where(jobs.c.axis == axis, jobs.c.kind == kind)
        if origin is not None:
            query = query.where(jobs.c.origin == origin)
        return self._one(query.order_by(jobs.c.created.desc(), jobs.c.id.desc()).limit(1))

    def outcomes(self) -> list[tuple[str, str, str, int]]:
        """(axis, kind, outcome, count) of all finished jobs."""
        query = select(jobs.c.axis, jobs.c.kind, jobs.c.outcome, func.count()).where(jobs.c.state == "done")
        query = query.group_by(jobs.c.axis, jobs.c.kind, jobs.c.outcome)
        with self._engine.connect() as connection:
            return [(a, k, o, n) for a, k, o, n in connection.execute(query) if o]

    # What was measured

    def known_runs(self, table: Table) -> set[str]:
        """Names of the run folders that are in `checks` or `runs`."""
        with self._engine.connect() as connection:
            return set(connection.execute(select(table.c.run)).scalars())

    def add_measured(
        self,
        table: Table,
        row: Mapping[str, Any],
        found: Iterable[Mapping[str, Any]],
        event: Mapping[str, Any],
    ) -> bool:
        """A check or run with its parameters and its event, all or nothing; False where it is there."""
        try:
            with self._engine.begin() as connection:
                connection.execute(insert(table).values(**row))
                for parameter in found:
                    connection.execute(insert(parameters).values(**parameter))
                if event:
                    connection.execute(insert(events).values(**event))
        except IntegrityError:
            return False
        self.additions += 1
        return True

    def list_checks(self, axis: str, limit: int | None = 400, whole: bool = True) -> list[Row]:
        """Newest checks of an axis, all without a limit, oldest first; without `whole` no JSON objects."""
        wanted = [column for column in checks.c if whole or column.name != "content"]
        query = select(*wanted).where(checks.c.axis == axis).order_by(checks.c.at.desc(), checks.c.run.desc())
        return self._all(query.limit(limit))[::-1]

    def list_runs(self, axis: str, limit: int = 200) -> list[Row]:
        """Newest runs of an axis, oldest first."""
        query = select(runs).where(runs.c.axis == axis).order_by(runs.c.at.desc(), runs.c.run.desc())
        return self._all(query.limit(limit))[::-1]

    def last_check(self, axis: str) -> Row | None:
        """The newest check of an axis."""
        found = self.list_checks(axis, 1)
        return found[0] if found else None

    def check_by_name(self, run: str) -> Row | None:
        """A check by the name of its folder."""
        return self._one(select(checks).where(checks.c.run == run))

    def run_by_name(self, run: str) -> Row | None:
        """A run by the name of its folder."""
        return self._one(select(runs).where(runs.c.run == run))

    def measured_by_name(self, run: str) -> Row | None:
        """A check or a run by the name of its folder."""
        return self.check_by_name(run) or self.run_by_name(run)

    def list_parameters(self, axis: str, name: str | None = None, limit: int = 5000) -> list[Row]:
        """Parameters over time, oldest first."""
        query = select(parameters).where(parameters.c.axis == axis)
        if name is not None:
            query = query.where(parameters.c.name == name)
        return self._all(query.order_by(parameters.c.at.desc(), parameters.c.id.desc()).limit(limit))[::-1]

    # Events

    def add_event(self, key: str, axis: str, at: datetime, kind: str, sentence: str) -> bool:
        """Adds an event; False where one with that key is there already."""
        try:
            with self._engine.begin() as connection:
                values = {"key": key[:160], "axis": axis, "at": text(at), "kind": kind, "sentence": sentence}
                connection.execute(insert(events).values(**values))
        except IntegrityError:
            return False
        self.additions += 1
        return True

    def list_events(self, axis: str | None = None, limit: int = 200) -> list[Row]:
        """Newest events, oldest first."""
        query = select(events).order_by(events.c.at.desc(), events.c.id.desc()).limit(limit)
        if axis is not None:
            query = query.where(events.c.axis == axis)
        return self._all(query)[::-1]

    def events_of(self, axis: str, kind: str) -> list[Row]:
        """All events of a kind."""
        query = select(events).where(events.c.axis == axis, events.c.kind == kind).order_by(events.c.id)
        return self._all(query)

    # Proposals and permissions

    def add_proposal(self, values: Mapping[str, Any]) -> None:
        """Adds a proposal; older open ones of the axis are superseded."""
        with self._engine.begin() as connection:
            mine = (proposals.c.axis == values["axis"]) & (proposals.c.state == "open")
            connection.execute(update(proposals).where(mine).values(state="superseded"))
            connection.execute(insert(proposals).values(**values))

    def close_proposals(self, axis: str, when: datetime, but: str) -> None:
        """Whatever is open on the axis, but for that of one run, is superseded by what has happened since."""
        with self._engine.begin() as connection:
            mine = (proposals.c.axis == axis) & (proposals.c.state == "open") & (proposals.c.run != but)
            connection.execute(update(proposals).where(mine).values(state="superseded", decided=text(when)))

    def decide_proposal(self, identifier: str, state: str, when: datetime) -> bool:
        """Approves or rejects; False where it is not open any more."""
        with self._engine.begin() as connection:
            mine = (proposals.c.id == identifier) & (proposals.c.state == "open")
            changed = connection.execute(
                update(proposals).where(mine).values(state=state, decided=text(when))
            )
            return bool(changed.rowcount)

    def proposal(self, identifier: str) -> Row | None:
        """A proposal by its id."""
        return self._one(select(proposals).where(proposals.c.id == identifier))

    def list_proposals(self, axis: str | None = None, limit: int = 50) -> list[Row]:
        """Newest proposals first."""
        query = select(proposals).order_by(proposals.c.created.desc(), proposals.c.id.desc()).limit(limit)
        if axis is not None:
            query = query.where(proposals.c.axis == axis)
        return self._all(query)

    def permit(self, axis: str, until: datetime) -> None:
        """The machine is idle until then."""
        with self._engine.begin() as connection:
            connection.execute(delete(permissions).where(permissions.c.axis == axis))
            connection.execute(insert(permissions).values(axis=axis, until=text(until)))

    def withdraw_permissions(self) -> None:
        """No machine counts as idle until somebody says so again."""
        with self._engine.begin() as connection:
            connection.execute(delete(permissions))

    def permitted_until(self, axis: str) -> datetime | None:
        """Until when the machine has been called idle."""
        row = self._one(select(permissions).where(permissions.c.axis == axis))
        return moment(row["until"]) if row else None

    def _all(self, query: Any) -> list[Row]:
        with self._engine.connect() as connection:
            return [dict(row) for row in connection.execute(query).mappings()]

    def _one(self, query: Any) -> Row | None:
        with self._engine.connect() as connection:
            row = connection.execute(query).mappings().first()
            return dict(row) if row is not None else None


def job_view(row: Row) -> Row:
    """A job as the API shows it."""
    return {**row, "options": json.loads(row["options"] or "{}")}


def contents(rows: Sequence[Row]) -> list[Row]:
    """The JSON objects that checks or runs left."""
    return [json.loads(row["content"]) for row in rows]
