"""Proposed commits that wait for a person, and idle permissions given by HTTP."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Adds the two tables."""
    op.create_table(
        "proposals",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("axis", sa.String(64), nullable=False),
        sa.Column("run", sa.String(128), nullable=False),
        sa.Column("created", sa.String(32), nullable=False),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("decided", sa.String(32)),
        sa.Column("sentence", sa.Text, nullable=False),
    )
    op.create_index("proposals_axis", "proposals", ["axis", "state"])
    op.create_table(
        "permissions",
        sa.Column("axis", sa.String(64), primary_key=True),
        sa.Column("until", sa.String(32), nullable=False),
    )


def downgrade() -> None:
    """Drops them."""
    op.drop_table("permissions")
    op.drop_table("proposals")
