"""Who has the axis: this command, or a service that then does the job; said either way."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from autotune.cli.output import say
from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError
from autotune.service.daemon.client import ServiceClient
from autotune.service.files import read_json
from autotune.service.ownership import Owner, key_of, owned, owner_of
from autotune.service.progress import Reporter


def service_of(axis: Axis, axis_file: Path) -> Owner | None:
    """The service that owns the axis; None where none does."""
    owner = owner_of(key_of(axis, axis_file))
    return owner if owner is not None and owner.address else None


@contextmanager
def holding(axis: Axis, axis_file: Path, what: str) -> Iterator[None]:
    """Holds the axis for this command.

    Raises:
        ConfigurationError: another program has it; a service is named with what to do.
    """
    owner = service_of(axis, axis_file)
    if owner is not None:
        raise ConfigurationError(
            f"axis {axis.name} is owned by the service at {owner.address}, which cannot do '{what}'; stop the "
            "service first ('systemctl stop autotune'), or end it with Ctrl-C"
        )
    with owned(axis, axis_file, what):
        yield


def let_service(owner: Owner, axis: Axis, kind: str, reporter: Reporter, **wish: Any) -> dict[str, Any]:
    """Has the service do a job, and follows it to its end; returns the job."""
    say(f"axis {axis.name} is owned by the service at {owner.address}; it does the {kind}")
    client = ServiceClient(owner)
    return client.follow(client.start(axis.name, kind, **wish), reporter)


def result_of(owner: Owner, job: dict[str, Any], name: str) -> dict[str, Any]:
    """What the service's job left, as the command itself would have printed it.

    Raises:
        ConfigurationError: the job left no result; says how it ended.
    """
    if not job.get("run"):
        raise JobFailed(str(job["sentence"]), int(job["exit_code"] or 2))
    folder = Path(owner.token_file).parent.parent
    return read_json(folder / str(job["run"]) / name, "result")


class JobFailed(ConfigurationError):
    """A job of the service that ended without a result, with its exit code."""

    def __init__(self, sentence: str, code: int) -> None:
        super().__init__(sentence)
        self.exit_code = code
