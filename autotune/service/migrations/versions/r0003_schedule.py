"""When each axis is looked at next, as text. Drops APScheduler's store, whose rows are pickles: reading one runs it."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """The next times are reckoned anew from the service file."""
    op.execute("DROP TABLE IF EXISTS apscheduler_jobs")
    op.create_table(
        "schedule",
        sa.Column("axis", sa.String(64), primary_key=True),
        sa.Column("expression", sa.String(256), nullable=False),
        sa.Column("zone", sa.String(64), nullable=False),
        sa.Column("next", sa.String(32)),
    )


def downgrade() -> None:
    """Drops it; nothing brings the pickles back."""
    op.drop_table("schedule")
