import pytest

from rarms_iac.storage.shipped import NotShipped, shipped


def test_the_findings_pages_are_found() -> None:
    assert shipped("docs/findings").is_dir()


def test_what_is_missing_is_named() -> None:
    with pytest.raises(NotShipped, match="docs/no-such-folder: install it again"):
        shipped("docs/no-such-folder")
