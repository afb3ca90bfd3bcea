"""An FMU (FMI 3.0, co-simulation) round the C file: sources, description, and a binary for this kind of host."""

from __future__ import annotations

import hashlib
import io
import platform
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path
from xml.sax.saxutils import escape

from autotune import __version__
from autotune.core.errors import ConfigurationError
from autotune.export.c_file import HEADER, SOURCE, export_c
from autotune.export.request import Exported, Request
from autotune.export.text import about, filled, headline

PLATFORM = "x86_64-linux"
_FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-Wall", "-Wextra", "-Werror")
_SECONDS = 60.0
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""Of all files inside: equal models give equal archives."""


def export_fmu(request: Request) -> Exported:
    """`autotune_ff.fmu`.

    Raises:
        ConfigurationError: no C compiler, or not the kind of host that the binary is for.
    """
    c = export_c(request)
    identifier = request.name
    token = hashlib.sha256(c.files[SOURCE]).hexdigest()[:32]
    told = f"{headline(request)} {' '.join(about(request, c.lost, '').split())}"
    words = {
        "identifier": identifier,
        "name": escape(request.model.axis or identifier, {'"': "'"}),
        "token": token,
        "description": escape(told, {'"': "'"}),
        "version": __version__,
        "period": repr(request.period),
        "motion": request.model.motion_unit,
        "torque": request.model.torque_symbol,
    }
    sources = {
        HEADER: c.files[HEADER],
        SOURCE: c.files[SOURCE],
        "fmu.c": filled("fmu.c", **words).encode("ascii"),
    }
    inside = {f"sources/{name}": content for name, content in sources.items()}
    inside["sources/buildDescription.xml"] = filled("buildDescription.xml", **words).encode("ascii")
    inside["modelDescription.xml"] = filled("modelDescription.xml", **words).encode("ascii")
    inside[f"binaries/{PLATFORM}/{identifier}.so"] = _compiled(sources)
    return Exported({f"{identifier}.fmu": _archive(inside)}, c.lost, c.notes)


def _compiled(sources: dict[str, bytes]) -> bytes:
    """The shared library of the sources."""
    host = f"{platform.machine()}-{sys.platform}"
    if host != PLATFORM:
        raise ConfigurationError(
            f"an FMU is compiled for {PLATFORM}, this host is {host}; export there, or use --to c"
        )
    compiler = next((found for name in ("cc", "gcc", "clang") if (found := shutil.which(name))), None)
    if compiler is None:
        raise ConfigurationError("an FMU needs a C compiler; install gcc or clang, or use --to c")
    with tempfile.TemporaryDirectory() as folder:
        for name, content in sources.items():
            Path(folder, name).write_bytes(content)
        names = [name for name in sources if name.endswith(".c")]
        command = [compiler, *_FLAGS, "-o", "made.so", *names, "-lm"]
        try:
            done = subprocess.run(
                command, cwd=folder, capture_output=True, text=True, timeout=_SECONDS, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise ConfigurationError(f"{compiler} does not compile the FMU: {error}") from error
        if done.returncode != 0:
            raise ConfigurationError(f"{compiler} does not compile the FMU: {done.stderr.strip()[-500:]}")
        return Path(folder, "made.so").read_bytes()


def _archive(inside: dict[str, bytes]) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in sorted(inside.items()):
            archive.writestr(zipfile.ZipInfo(name, _EPOCH), content, zipfile.ZIP_DEFLATED)
    return packed.getvalue()
