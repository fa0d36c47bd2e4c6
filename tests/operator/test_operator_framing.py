"""Who may show the gateway's page inside another one."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("aiohttp")

from usarsim_report.page_files import page_file, page_headers


def ancestors(*hosts: str) -> str:
    """The last directive of the policy."""
    return page_headers(hosts)["Content-Security-Policy"].rsplit("; ", 1)[1]


def test_nobody_shows_the_page_unless_named() -> None:
    assert ancestors() == "frame-ancestors 'none'"
    assert ancestors("[::1]:80") == "frame-ancestors 'none'"
    assert ancestors("127.0.0.1:9000") == (
        "frame-ancestors http://127.0.0.1:9000 https://127.0.0.1:9000"
    )
    policy = page_headers(frames="http://127.0.0.1:*")["Content-Security-Policy"]
    assert "frame-src http://127.0.0.1:*;" in policy
    assert "unsafe" not in policy


def test_only_files_of_the_folder_are_served(tmp_path: Path) -> None:
    folder = (tmp_path / "page").resolve()
    folder.mkdir()
    (folder / "study.html").write_text("<p>Study")
    (tmp_path / "key").write_text("secret")
    headers = page_headers()
    assert page_file(folder, "", headers, "study.html").body == b"<p>Study"
    for name in ("../key", "\0", "nothing", ".", "study.html/../../key"):
        assert page_file(folder, name, headers).status == 404, name
    assert "make page" in (page_file(folder, "", headers).text or "")
