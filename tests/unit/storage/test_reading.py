import io
from pathlib import Path

import pytest

from rarms_iac.storage.codec import NotDecodable
from rarms_iac.storage.disk import NotRegular
from rarms_iac.storage.json_text import parse_json
from rarms_iac.storage.reading import TooLarge, read_file, read_input
from tests.needs import require


def test_file_is_read_to_its_limit(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_bytes(b"12345")

    assert read_file(file, 5) == b"12345"
    with pytest.raises(TooLarge, match="more than 4 bytes"):
        read_file(file, 4)


def test_standard_input_is_read_to_its_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"12345678")))

    assert read_input("-", 4096) == b"12345678"
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"12345678")))
    with pytest.raises(TooLarge):
        read_input("-", 7)


@pytest.mark.needs("linux")
@pytest.mark.parametrize("name", ["/proc/kmsg", "/proc/self/environ", "/sys/kernel/mm/transparent_hugepage/enabled"])
def test_kernel_file_is_no_regular_file(name: str, tmp_path: Path) -> None:
    link = tmp_path / "link"
    link.symlink_to(name)

    for path in (Path(name), link):
        with pytest.raises(NotRegular, match="a file of the kernel"):
            read_file(path, 100)


def test_a_link_counts_as_what_it_leads_to(tmp_path: Path) -> None:
    require("posix")
    (tmp_path / "file").write_bytes(b"text")
    (tmp_path / "link").symlink_to("file")
    (tmp_path / "endless").symlink_to("/dev/zero")

    assert read_file(tmp_path / "link", 10) == b"text"
    with pytest.raises(NotRegular, match="device"):
        read_file(tmp_path / "endless", 10)


@pytest.mark.parametrize("number", ["1e999", "-1E+400", "1" * 400 + ".0"])
def test_number_that_no_float_can_hold_is_refused(number: str) -> None:
    with pytest.raises(NotDecodable, match="too large"):
        parse_json(f'{{"response_ms": [1.5, {number}]}}')


def test_text_that_looks_like_huge_number_is_text() -> None:
    assert parse_json('{"id": "3e9995", "small": 1e-999}') == {"id": "3e9995", "small": 0.0}
