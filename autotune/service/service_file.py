"""Which service file counts, where its service can be asked, and its token: one rule for service and command line.

The rule: the file that is named; else the one in AUTOTUNE_SERVICE; else the first that is there of
`service.toml` and `config/service.toml` in the working directory, `/etc/autotune/service.toml`, and the example
that came with the program. A file that was not named must be one that no other user can change (`trust`): it
says where the token goes. The token is in AUTOTUNE_TOKEN, in the user's own `~/.config/autotune/token`, or in the
service's folder for whoever may read that.
"""

from __future__ import annotations

import os
import re
import secrets
from contextlib import suppress
from pathlib import Path

from autotune.core.errors import ConfigurationError
from autotune.core.paths import config_directory
from autotune.service.settings import Configuration, Http
from autotune.service.trust import distrust, open_plain, read_plain

INSTALLED = Path("/etc/autotune/service.toml")
TOKEN = re.compile(r"[A-Za-z0-9_.~+/=-]{16,256}")
"""What a token may look like (RFC 6750, section 2.1); anything else in its place is never sent anywhere."""
EVERYWHERE = {"0.0.0.0": "127.0.0.1", "::": "::1", "": "127.0.0.1"}  # noqa: S104 - compared with, never bound
"""Addresses on which a service listens everywhere, and where it is asked then."""


def service_file(named: Path | None = None) -> Path:
    """The service file by the rule.

    Raises:
        ConfigurationError: the one that the rule finds could have been changed by another user.
    """
    chosen = named or (Path(os.environ["AUTOTUNE_SERVICE"]) if os.environ.get("AUTOTUNE_SERVICE") else None)
    if chosen is not None:
        return chosen
    usual = (Path("service.toml"), Path("config", "service.toml"), INSTALLED)
    found = next((path for path in usual if path.is_file()), config_directory() / "service.toml")
    if problem := distrust(found):
        raise ConfigurationError(
            f"the service file {found.absolute()} is not used unnamed, since {problem}; name it "
            f"(AUTOTUNE_SERVICE={found.absolute()}) if you trust it"
        )
    return found


def address_of(configuration: Configuration) -> str:
    """Where the service of a configuration is asked; with `http.port = 0` it is what the service noted last.

    Raises:
        ConfigurationError: it has noted nothing.
    """
    http = configuration.service.http
    port = http.port or _noted_port(configuration)
    return url_of(http, port)


def url_of(http: Http, port: int) -> str:
    """The URL of a service on this machine."""
    host = EVERYWHERE.get(http.host, http.host)
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def _noted_port(configuration: Configuration) -> int:
    path = port_file(configuration.state)
    try:
        if problem := distrust(path):
            raise ConfigurationError(f"{path} is not believed, since {problem}")
        return int(read_plain(path))
    except (OSError, ValueError) as error:
        if isinstance(error, ConfigurationError):
            raise
        raise ConfigurationError(
            f"no service of {configuration.file} is running: {path} does not name its port"
        ) from None


def port_file(state: Path) -> Path:
    """Where a service notes the port that it was given."""
    return state / "port"


def token_file(state: Path) -> Path:
    """Where the token is."""
    return state / "token"


def users_token_file() -> Path:
    """Where a user may keep the token of a service that is somebody else's."""
    home = os.environ.get("XDG_CONFIG_HOME") or "~/.config"
    return Path(home).expanduser() / "autotune" / "token"


def known_token(configuration: Configuration) -> str:
    """The token that this user has; "" where there is none.

    Raises:
        ConfigurationError: what is in its place is not a token.
    """
    if given := os.environ.get("AUTOTUNE_TOKEN", ""):
        return _checked(given, "the environment variable AUTOTUNE_TOKEN")
    for path in (users_token_file(), token_file(configuration.state)):
        with suppress(OSError):
            return _checked(read_plain(path).strip(), str(path))
    return ""


def _checked(token: str, where: str) -> str:
    if not TOKEN.fullmatch(token):
        raise ConfigurationError(f"{where} does not hold a token (16 to 256 letters, digits or -_.~+/=)")
    return token


def token_of(state: Path) -> str:
    """The token that writing needs: made on the first start, readable by the owner only.

    An empty file, which a power cut can leave, is no token that anybody has: a new one is made.

    Raises:
        ConfigurationError: what is there is no token, or is not the service's alone.
    """
    path = token_file(state)
    state.mkdir(parents=True, exist_ok=True)
    token = ""
    with suppress(FileNotFoundError):
        token = _own_secret(path)
    if not token:
        token = secrets.token_urlsafe(32)
        write_own(path, token + "\n", 0o600)
    if not TOKEN.fullmatch(token):
        raise ConfigurationError(f"{path} does not hold a token; delete the file, and a new one is made")
    return token


def _own_secret(path: Path) -> str:
    """The text of a file that nobody else may read or write; one that others may is closed to them.

    Raises:
        FileNotFoundError: it is not there.
        ConfigurationError: it belongs to another user, others could write to it, or it is no plain file.
    """
    try:
        descriptor = open_plain(path)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise ConfigurationError(f"the token {path} cannot be used ({error.strerror}); delete it") from error
    try:
        found = os.fstat(descriptor)
        if found.st_uid != os.geteuid() or found.st_mode & 0o022:
            raise ConfigurationError(
                f"others could have written the token {path}; delete the file, and a new one is made"
            )
        if found.st_mode & 0o004:
            raise ConfigurationError(
                f"everybody could read the token {path}; delete the file, and a new one is made"
            )
        return os.read(descriptor, 4096).decode(errors="replace").strip()
    finally:
        os.close(descriptor)


def write_own(path: Path, text: str, mode: int) -> None:
    """Writes a small file whole, with its mode from the beginning, so that it survives a power cut."""
    temporary = path.with_name(f".{path.name}.part")
    temporary.unlink(missing_ok=True)
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, mode)
    try:
        os.write(descriptor, text.encode())
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
    os.replace(temporary, path)
