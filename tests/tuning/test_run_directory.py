"""Names of run folders and backups sort in the order in which they were made, whatever the clock does."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from autotune.tuning.backup import backup_ids, take_backup
from autotune.tuning.files import stamp_after
from autotune.tuning.run_directory import make_run_directory

NOW = datetime(2026, 10, 25, 2, 30)


def test_a_clock_put_back_makes_no_later_run_an_earlier_one(tmp_path: Path) -> None:
    jumps = [0, 0, -5 * 3600, 1, 3600, -365 * 24 * 3600]
    made = [make_run_directory(tmp_path, "one", NOW + timedelta(seconds=s)).name for s in jumps]
    assert made == sorted(set(made))
    assert made[0] == "20261025-023000-one"
    assert make_run_directory(tmp_path, "two", NOW).name == "20261025-023000-two"
    taken = [take_backup(tmp_path, "one", {}, {"a": 1.0}, NOW + timedelta(seconds=s)).id for s in jumps]
    assert backup_ids(tmp_path, "one") == taken


@given(st.lists(st.text("0123456789-a", max_size=20), max_size=5), st.datetimes(datetime(2000, 1, 1)))
def test_the_stamp_is_that_of_now_or_after_all_that_are_stamps(present: list[str], now: datetime) -> None:
    found = stamp_after(present, now)
    assert found == f"{now:%Y%m%d-%H%M%S}" or any(found > name[:15] for name in present)
