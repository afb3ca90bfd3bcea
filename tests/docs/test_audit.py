"""`make audit` says what is known, and never "nothing known" where nothing could be looked up."""

from __future__ import annotations

from bench.audit import judge

SOUND = {"name": "sound", "version": "1.0", "vulns": []}
WEAK = {"name": "weak", "version": "1.0", "vulns": [{"id": "CVE-1", "fix_versions": ["1.1"]}]}
UNKNOWN = {"name": "unknown", "skip_reason": "not found"}


def test_a_known_weakness_fails_and_names_the_version_that_mends_it() -> None:
    code, lines = judge({"dependencies": [SOUND, WEAK, UNKNOWN]})
    assert code == 1
    assert lines == [
        "weak 1.0: CVE-1, mended in 1.1",
        "2 of 3 packages looked up, 1 with a problem",
        "not looked up: unknown",
    ]


def test_where_nothing_could_be_looked_up_this_is_skipped_and_not_sound() -> None:
    for packages in ([UNKNOWN], []):
        code, lines = judge({"dependencies": packages})
        assert code == 0
        assert lines[0].startswith("skipped")
    assert judge({"dependencies": [SOUND]}) == (0, ["1 of 1 packages looked up, 0 with a problem"])
