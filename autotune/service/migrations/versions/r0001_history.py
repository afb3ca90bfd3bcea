"""First schema: jobs, checks, runs, parameters, events."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None


def _text(name: str, size: int, nullable: bool = False) -> sa.Column[str]:
    return sa.Column(name, sa.String(size), nullable=nullable)


def upgrade() -> None:
    """Makes the tables."""
    op.create_table(
        "jobs",
        sa.Column("id", sa.String(32), primary_key=True),
        _text("axis", 64), _text("kind", 16), _text("due", 32, True), _text("origin", 32),
        _text("state", 16), _text("created", 32), _text("started", 32, True), _text("finished", 32, True),
        sa.Column("attempts", sa.Integer, nullable=False),
        _text("outcome", 32, True),
        sa.Column("exit_code", sa.Integer),
        sa.Column("sentence", sa.Text),
        _text("run", 128, True),
        sa.Column("options", sa.Text, nullable=False),
        sa.UniqueConstraint("axis", "kind", "due", name="jobs_once"),
    )  # fmt: skip
    op.create_index("jobs_state", "jobs", ["state"])
    op.create_index("jobs_axis", "jobs", ["axis", "created"])
    op.create_table(
        "checks",
        sa.Column("run", sa.String(128), primary_key=True),
        _text("axis", 64), _text("at", 32), _text("drift", 16),
        sa.Column("beyond", sa.Boolean, nullable=False),
        sa.Column("change", sa.Float),
        *(sa.Column(name, sa.Float, nullable=False) for name in ("level", "level_error")),
        sa.Column("temperature", sa.Float),
        *(sa.Column(name, sa.Float, nullable=False) for name in ("peak_error", "uncompensated")),
        *(sa.Column(name, sa.Integer, nullable=False) for name in ("missed", "samples")),
        *(sa.Column(name, sa.Text, nullable=False) for name in ("sentence", "content")),
    )  # fmt: skip
    op.create_index("checks_axis", "checks", ["axis", "at"])
    op.create_table(
        "runs",
        sa.Column("run", sa.String(128), primary_key=True),
        _text("axis", 64), _text("at", 32), _text("outcome", 32),
        *(sa.Column(name, sa.Float) for name in ("before", "after", "committed")),
        sa.Column("machine_seconds", sa.Float, nullable=False),
        *(sa.Column(name, sa.Text, nullable=False) for name in ("sentence", "content")),
    )  # fmt: skip
    op.create_index("runs_axis", "runs", ["axis", "at"])
    op.create_table(
        "parameters",
        sa.Column("id", sa.Integer, primary_key=True, autoincrement=True),
        _text("axis", 64), _text("at", 32), _text("run", 128), _text("source", 16), _text("name", 64),
        sa.Column("value", sa.Float, nullable=False),
        sa.Column("standard_error", sa.Float),
        _text("unit", 32),
        sa.UniqueConstraint("run", "name", name="parameters_once"),
    )  # fmt: skip
    op.create_index("parameters_axis", "parameters", ["axis", "name", "at"])
    op.create_table(
        "events",
        sa.Column("id", sa.Integer, primary_key=True, autoincrement=True),
        sa.Column("key", sa.String(160), nullable=False, unique=True),
        _text("axis", 64), _text("at", 32), _text("kind", 32),
        sa.Column("sentence", sa.Text, nullable=False),
    )  # fmt: skip
    op.create_index("events_axis", "events", ["axis", "at"])


def downgrade() -> None:
    """Drops them."""
    for name in ("events", "parameters", "runs", "checks", "jobs"):
        op.drop_table(name)
