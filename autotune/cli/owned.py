"""Who has the axis: this command, or a service that then does the job; said either way."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from autotune.cli.output import say
from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError
from autotune.service.ownership import in_use, key_of, owned, owner_of
from autotune.tuning.progress import Reporter

if TYPE_CHECKING:
    from autotune.service.client import ServiceClient


@dataclass(frozen=True, slots=True)
class Service:
    """A service that has the axis; `axis` as its own files describe it."""

    client: ServiceClient
    axis: Axis

    @property
    def address(self) -> str:
        return self.client.address


def service_of(axis: Axis, axis_file: Path) -> Service | None:
    """The service that owns the axis; None where nobody does.

    Which one that can be says the service file (`service_file`), not whoever holds the lock.

    Raises:
        ConfigurationError: another program has the axis's link.
    """
    key = key_of(axis, axis_file)
    holder = owner_of(key)
    if holder is None:
        return None
    from autotune.service.client import NoService, ServiceClient
    from autotune.service.service_file import service_file
    from autotune.service.settings import read_service

    sentence = in_use(axis.name, key.bus, holder)
    try:
        configuration = read_service(service_file(), planned=False)
        watched = next((one for one in configuration.axes if one.key == key.drive), None)
        if watched is None:
            hint = f"if that is a service, name its file (AUTOTUNE_SERVICE=FILE): {configuration.file} does not list it"
            raise ConfigurationError(f"{sentence}; {hint}")
        service = Service(ServiceClient(configuration), watched.axis)
        if not service.client.holds(watched.name):
            raise ConfigurationError(f"{sentence}; the service at {service.address} waits for it as well")
    except NoService as error:
        raise ConfigurationError(f"{sentence} ({error})") from None
    return service


@contextmanager
def holding(axis: Axis, axis_file: Path, what: str) -> Iterator[None]:
    """Holds the axis for this command.

    Raises:
        ConfigurationError: another program has it; a service is named with what to do.
    """
    service = service_of(axis, axis_file)
    if service is not None:
        raise ConfigurationError(
            f"axis {axis.name} is owned by the service at {service.address}, which cannot do '{what}'; stop the "
            "service first ('systemctl stop autotune'), or end it with Ctrl-C"
        )
    with owned(axis, axis_file, what):
        yield


def let_service(service: Service, kind: str, reporter: Reporter, **wish: Any) -> dict[str, Any]:
    """Has the service do a job, and follows it to its end; returns the job."""
    say(f"axis {service.axis.name} is owned by the service at {service.address}; it does the {kind}")
    return service.client.follow(service.client.start(service.axis.name, kind, **wish), reporter)


def result_of(service: Service, job: dict[str, Any]) -> dict[str, Any]:
    """What the service's job left, as the command itself would have printed it.

    Raises:
        ConfigurationError: the job left no result; says how it ended.
    """
    if not job.get("run"):
        raise JobFailed(str(job["sentence"]), int(job["exit_code"] or 2))
    return service.client.result(job)


class JobFailed(ConfigurationError):
    """A job of the service that ended without a result, with its exit code."""

    def __init__(self, sentence: str, code: int) -> None:
        super().__init__(sentence)
        self.exit_code = code
