"""`/metrics` for Prometheus, read from the history and the manager when asked."""

from __future__ import annotations

from collections.abc import Iterator

from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.metrics_core import CounterMetricFamily
from prometheus_client.registry import Collector

from autotune.service import housekeeping
from autotune.service.manager import Manager
from autotune.service.store import Row, moment

_CHECK_GAUGES = (
    ("autotune_friction", "Friction level of the last check [N m or N].", "level"),
    ("autotune_friction_standard_error", "Its standard error [N m or N].", "level_error"),
    ("autotune_friction_change_ratio", "Friction relative to the committed model, 0: the same.", "change"),
    ("autotune_tracking_error", "Peak error on the benchmark [rad or m].", "peak_error"),
    ("autotune_tracking_error_uncompensated", "The same without compensation [rad or m].", "uncompensated"),
    ("autotune_temperature_celsius", "Temperature during the last check.", "temperature"),
)


class _Service(Collector):
    def __init__(self, manager: Manager) -> None:
        self._manager = manager

    def collect(self) -> Iterator[Metric]:
        """Everything, each metric a family over the axes."""
        manager = self._manager
        last = {one.name: manager.store.last_check(one.name) for one in manager.configuration.axes}
        checks = {axis: row for axis, row in last.items() if row is not None}
        for name, about, column in _CHECK_GAUGES:
            family = GaugeMetricFamily(name, about, labels=["axis"])
            for axis, row in checks.items():
                if row[column] is not None:
                    family.add_metric([axis], row[column])
            yield family
        yield _stamps(checks)
        yield _lateness(checks)
        yield self._outcomes()
        yield self._running()
        yield from self._service()

    def _outcomes(self) -> Metric:
        family = CounterMetricFamily("autotune_jobs", "Jobs by outcome.", labels=["axis", "kind", "outcome"])
        for axis, kind, outcome, count in self._manager.store.outcomes():
            family.add_metric([axis, kind, outcome], count)
        return family

    def _running(self) -> Metric:
        family = GaugeMetricFamily("autotune_job_running", "Whether a job is under way.", labels=["axis"])
        busy = {running.axis.name for running in self._manager.running.values()}
        for one in self._manager.configuration.axes:
            family.add_metric([one.name], float(one.name in busy))
        return family

    def _service(self) -> Iterator[Metric]:
        runs, health = self._manager.configuration.runs, self._manager.health
        yield GaugeMetricFamily(
            "autotune_recordings_bytes",
            "Disk that recordings, traces and reports take.",
            health.recordings_bytes,
        )
        yield GaugeMetricFamily(
            "autotune_disk_free_bytes", "Room left on that disk.", housekeeping.free(runs)
        )
        yield GaugeMetricFamily(
            "autotune_problems", "Present problems of the service.", len(self._manager.problems())
        )
        yield GaugeMetricFamily(
            "autotune_history_restored",
            "1: the history was torn and a backup took its place.",
            float(bool(health.restored)),
        )
        yield CounterMetricFamily(
            "autotune_notices_lost", "Notices that the webhook did not take.", health.notices_lost
        )
        yield GaugeMetricFamily("autotune_event_followers", "Open event streams.", self._manager.feed.count)


def _stamps(checks: dict[str, Row]) -> Metric:
    family = GaugeMetricFamily(
        "autotune_last_check_timestamp_seconds", "When the last check was made.", labels=["axis"]
    )
    for axis, row in checks.items():
        family.add_metric([axis], moment(row["at"]).timestamp())
    return family


def _lateness(checks: dict[str, Row]) -> Metric:
    family = GaugeMetricFamily(
        "autotune_cycles_missed_ratio", "Share of control cycles lost in the last check.", labels=["axis"]
    )
    for axis, row in checks.items():
        family.add_metric([axis], row["missed"] / max(row["samples"], 1))
    return family


def exposition(manager: Manager) -> bytes:
    """The text that Prometheus reads."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Service(manager))
    return generate_latest(registry)
