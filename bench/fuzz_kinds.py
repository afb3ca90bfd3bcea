"""What is fuzzed: for each kind of input how it is made, read, and judged.

`run` returns True where the input was accepted and False where it was refused in words; it raises `Found`
where a judge that shares no code with the reader says that what was accepted must not be.
"""

from __future__ import annotations

from autotune.core.axis import read_axis
from autotune.models.model_file import read_model
from bench.fuzz_judging import Kind
from bench.fuzz_mutation import mutated
from bench.fuzz_recordings import importer, make_parquet, read_recording_csv, read_recording_parquet
from bench.fuzz_state import (
    make_json,
    make_toml,
    read_any_profile,
    read_api,
    read_backup,
    read_findings,
    read_journal,
    service_file,
    toml_kind,
)
from bench.fuzz_wires import (
    hex_frame,
    read_eds,
    read_link,
    read_moteus_frame,
    read_moteus_line,
    read_sdo,
    read_slcan,
)

KINDS: tuple[Kind, ...] = (
    Kind("slcan", 300, mutated, read_slcan),
    Kind("moteus_line", 150, mutated, read_moteus_line),
    Kind("moteus_frame", 150, mutated, lambda data, folder: read_moteus_frame(hex_frame(data), folder)),
    Kind("sdo", 100, mutated, read_sdo),
    Kind("link", 100, mutated, read_link),
    Kind("eds", 60, mutated, read_eds),
    Kind("journal", 30, make_json, read_journal),
    Kind("backup", 20, make_json, read_backup),
    Kind("findings", 20, make_json, read_findings),
    Kind("axis", 20, make_toml, toml_kind(read_axis, lambda axis: axis.model_dump())),
    Kind("profile", 10, make_toml, toml_kind(read_any_profile, lambda profile: profile.model_dump())),
    Kind("service", 10, make_toml, toml_kind(service_file, lambda found: found.model_dump())),
    Kind(
        "model", 10, make_toml, toml_kind(read_model, lambda m: {n: v.value for n, v in m.parameters.items()})
    ),
    Kind("api", 20, mutated, read_api),
    Kind("recording_csv", 10, mutated, read_recording_csv),
    Kind("recording_parquet", 8, make_parquet, read_recording_parquet),
    Kind("import_csv", 5, mutated, importer("csv", "csv")),
    Kind("import_epos", 5, mutated, importer("epos", "csv", "torque=Torque actual value averaged*1e-4")),
    Kind("import_parquet", 4, make_parquet, importer("parquet", "parquet")),
    Kind("import_mat", 0.1, mutated, importer("mat", "mat", "time=t", "position=q", "torque=torque*kt")),
)
