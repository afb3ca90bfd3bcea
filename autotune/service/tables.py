"""Tables of the history. Times are UTC texts `YYYY-MM-DDTHH:MM:SS+00:00`, which sort as they should.

`runs` of the folder are the source of what was measured: `checks` and `runs` can be filled again from
the files there. `jobs`, `events`, `proposals`, `permissions` and `schedule` are the service's own. All of it is
text and numbers: nothing that is read from here can run.
"""

from __future__ import annotations

from sqlalchemy import Boolean, Column, Float, Index, Integer, MetaData, String, Table, Text, UniqueConstraint

metadata = MetaData()

jobs = Table(
    "jobs",
    metadata,
    Column("id", String(32), primary_key=True),
    Column("axis", String(64), nullable=False),
    Column("kind", String(16), nullable=False),
    Column("due", String(32)),
    Column("origin", String(32), nullable=False),
    Column("state", String(16), nullable=False),
    Column("created", String(32), nullable=False),
    Column("started", String(32)),
    Column("finished", String(32)),
    Column("attempts", Integer, nullable=False, default=0),
    Column("outcome", String(32)),
    Column("exit_code", Integer),
    Column("sentence", Text),
    Column("run", String(128)),
    Column("options", Text, nullable=False, default="{}"),
    UniqueConstraint("axis", "kind", "due", name="jobs_once"),
    Index("jobs_state", "state"),
    Index("jobs_axis", "axis", "created"),
)

checks = Table(
    "checks",
    metadata,
    Column("run", String(128), primary_key=True),
    Column("axis", String(64), nullable=False),
    Column("at", String(32), nullable=False),
    Column("drift", String(16), nullable=False),
    Column("beyond", Boolean, nullable=False),
    Column("change", Float),
    Column("level", Float, nullable=False),
    Column("level_error", Float, nullable=False),
    Column("temperature", Float),
    Column("peak_error", Float, nullable=False),
    Column("uncompensated", Float, nullable=False),
    Column("missed", Integer, nullable=False),
    Column("samples", Integer, nullable=False),
    Column("sentence", Text, nullable=False),
    Column("content", Text, nullable=False),
    Index("checks_axis", "axis", "at"),
)

runs = Table(
    "runs",
    metadata,
    Column("run", String(128), primary_key=True),
    Column("axis", String(64), nullable=False),
    Column("at", String(32), nullable=False),
    Column("outcome", String(32), nullable=False),
    Column("before", Float),
    Column("after", Float),
    Column("committed", Float),
    Column("machine_seconds", Float, nullable=False),
    Column("sentence", Text, nullable=False),
    Column("content", Text, nullable=False),
    Index("runs_axis", "axis", "at"),
)

parameters = Table(
    "parameters",
    metadata,
    Column("id", Integer, primary_key=True, autoincrement=True),
    Column("axis", String(64), nullable=False),
    Column("at", String(32), nullable=False),
    Column("run", String(128), nullable=False),
    Column("source", String(16), nullable=False),
    Column("name", String(64), nullable=False),
    Column("value", Float, nullable=False),
    Column("standard_error", Float),
    Column("unit", String(32), nullable=False),
    UniqueConstraint("run", "name", name="parameters_once"),
    Index("parameters_axis", "axis", "name", "at"),
)

events = Table(
    "events",
    metadata,
    Column("id", Integer, primary_key=True, autoincrement=True),
    Column("key", String(160), nullable=False, unique=True),
    Column("axis", String(64), nullable=False),
    Column("at", String(32), nullable=False),
    Column("kind", String(32), nullable=False),
    Column("sentence", Text, nullable=False),
    Index("events_axis", "axis", "at"),
)

proposals = Table(
    "proposals",
    metadata,
    Column("id", String(32), primary_key=True),
    Column("axis", String(64), nullable=False),
    Column("run", String(128), nullable=False),
    Column("created", String(32), nullable=False),
    Column("state", String(16), nullable=False),
    Column("decided", String(32)),
    Column("sentence", Text, nullable=False),
    Index("proposals_axis", "axis", "state"),
)

permissions = Table(
    "permissions",
    metadata,
    Column("axis", String(64), primary_key=True),
    Column("until", String(32), nullable=False),
)

schedule = Table(
    "schedule",
    metadata,
    Column("axis", String(64), primary_key=True),
    Column("expression", String(256), nullable=False),
    Column("zone", String(64), nullable=False),
    Column("next", String(32)),
)
