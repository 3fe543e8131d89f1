"""What a release says of itself in more than one file agrees."""

import re

from markdown_pages import ROOT

HEADING = re.compile(r"^## \[(\d[^\]]*)\] - (\d{4}-\d{2}-\d{2})$", flags=re.MULTILINE)
KEY = re.compile(r'^(version|date-released): "?([^"\n]+)"?$', flags=re.MULTILINE)


def cited(changelog: str) -> dict[str, str]:
    """What a citation states beside a changelog: its newest release, nothing before the first one."""
    released = HEADING.search(changelog)
    return {} if released is None else {"version": released[1], "date-released": released[2]}


def test_the_citation_is_of_the_newest_release():
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert dict(KEY.findall((ROOT / "CITATION.cff").read_text(encoding="utf-8"))) == cited(changelog)


def test_a_release_is_found_in_a_changelog():
    text = "# Changelog\n\n## [Unreleased]\n\n## [0.2.0] - 2026-12-01\n\n### Added\n\n## [0.1.0] - 2026-01-02\n"
    assert cited(text) == {"version": "0.2.0", "date-released": "2026-12-01"}
    assert cited(text.partition("## [0.2.0]")[0]) == {}
    assert KEY.findall('title: a\nversion: 0.2.0\ndate-released: "2026-12-01"\n') == [
        ("version", "0.2.0"),
        ("date-released", "2026-12-01"),
    ]
