"""What follows from a job that has ended: events, notices, a proposal, a re-tune."""

from __future__ import annotations

import json
import logging
import secrets
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from autotune.service import observe
from autotune.service.feed import Feed
from autotune.service.orders import Done
from autotune.service.settings import WatchedAxis
from autotune.service.store import Row, Store, contents, moment, text
from autotune.tuning.accepted import FILE_NAME as ACCEPTED

log = logging.getLogger("autotune.service")
WORTH_A_WORD = ("guard", "fault", "died", "refused", "rolled_back")
ACCEPTED_WORDS = "Told again only when the axis moves further; if it should be better, look at its mechanics."
Notify = Callable[[Mapping[str, Any]], None]
Submit = Callable[[str, str, str], Row | None]


class FollowUp:
    """Decides nothing by itself (`observe` does); `submit` queues a job of a kind on an axis."""

    def __init__(self, store: Store, runs: Path, feed: Feed, notify: Notify, submit: Submit) -> None:
        self._store, self._runs, self._feed, self._notify, self._submit = store, runs, feed, notify, submit

    def propose(self, row: Row, done: Done, now: datetime) -> None:
        """What a run has proved and a person has to approve; before the job counts as done, so that it is not lost.

        Done again for the same run it supersedes its own proposal, and says nothing twice.
        """
        run = self._store.run_by_name(done.run) if done.asked and done.run else None
        if row["kind"] != "run" or done.outcome != "not_applied" or run is None:
            return
        axis = row["axis"]
        unit = json.loads(run["content"]).get("motion_unit", "rad")
        peaks = f"{1e3 * run['before']:.2f} to {1e3 * run['after']:.2f} m{unit}"
        sentence = f"Proved on axis {axis}, and waiting for approval: peak error from {peaks}. {done.asked}"
        self._store.add_proposal(
            {"id": new_id(now, 0), "axis": axis, "run": done.run, "created": text(now), "state": "open",
             "sentence": sentence}
        )  # fmt: skip
        self.event("proposal", axis, now, sentence, row["id"], notice=True)

    def after(self, row: Row, done: Done, watched: WatchedAxis | None, now: datetime) -> None:
        """Everything else, once the job is done."""
        axis = row["axis"]
        if done.outcome in WORTH_A_WORD:
            sentence = f"The {row['kind']} of axis {axis} ended: {done.sentence}"
            self.event(done.outcome, axis, now, sentence, row["id"], notice=True)
        if row["kind"] == "rollback" and done.exit_code == 0:
            self.event("rollback", axis, now, done.sentence, row["id"])
        if row["kind"] in ("run", "commit", "rollback"):
            self._after_tuning(row, done, now)
        elif done.outcome == "done":
            self._after_check(row, done, watched, now)

    def _after_tuning(self, row: Row, done: Done, now: datetime) -> None:
        axis = row["axis"]
        if done.outcome == "kept":
            self._notify({"kind": "commit", "axis": axis, "at": text(now), "sentence": done.sentence})
        if done.run and (self._runs / done.run / ACCEPTED).is_file():
            sentence = f"{done.sentence} {ACCEPTED_WORDS}"
            self.event("accepted", axis, now, sentence, row["id"], notice=row["origin"] == "drift")
        self._store.close_proposals(axis, now, but=done.run)

    def _after_check(self, row: Row, done: Done, watched: WatchedAxis | None, now: datetime) -> None:
        axis = row["axis"]
        found = self._store.check_by_name(done.run)
        if found is None:
            return
        content = json.loads(found["content"])
        state = content["drift"]["state"]
        if state not in ("none", "unknown"):
            words = f"{content['verdict']} {content['advice']}".strip()
            states = [row["drift"] for row in self._store.list_checks(axis, None, whole=False)]
            self.event(f"drift:{state}", axis, now, words, done.run, notice=observe.worth_a_notice(states))
        self._tell_changes(axis, now)
        if not content["drift"]["wants_tuning"] or watched is None or watched.settings.retune != "drift":
            return
        tuned = self._store.last_job(axis, "run")
        when = moment(tuned["finished"] or tuned["created"]) if tuned else None
        if observe.may_tune(tuned, when, now) and self._submit(axis, "run", "drift"):
            self.event("retune", axis, now, f"Re-tuning axis {axis}: {content['verdict']}", done.run)

    def _tell_changes(self, axis: str, now: datetime) -> None:
        trend = observe.trend_of(contents(self._store.list_checks(axis)))
        told = [
            one for event in self._store.events_of(axis, "change") if (one := observe.decode(event["key"]))
        ]
        for one, sentence in observe.news(trend, told):
            self.event("change", axis, now, sentence, f"{axis}:trend:{observe.encode(one)}", notice=True)

    def event(
        self, kind: str, axis: str, now: datetime, sentence: str, key: str = "", notice: bool = False
    ) -> None:
        """Adds an event; where it is new, followers hear of it, and with `notice` a person too."""
        fresh = self._store.add_event(
            key if ":trend:" in key else f"{kind}:{key or text(now)}", axis, now, kind, sentence
        )
        if not fresh:
            return
        message = {"kind": kind, "axis": axis, "at": text(now), "sentence": sentence}
        self._feed.tell({"event": "event", **message})
        if notice:
            log.warning("axis %s: %s", axis, sentence)
            self._notify(message)


def new_id(now: datetime, count: int) -> str:
    """32 hex digits that sort by time, then by order within this process."""
    return f"{int(now.timestamp() * 1000):012x}{count:06x}{secrets.token_hex(7)}"
