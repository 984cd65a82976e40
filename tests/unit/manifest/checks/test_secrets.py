import pytest

from rarms_iac.manifest.checks.secrets import is_reference


@pytest.mark.parametrize(
    ("text", "reference"),
    [
        ("robot/guest", True),
        ("guest-1", True),
        ("Tr0ub4dor&3", False),
        ("correct horse", False),
        ("QnLw8sX2pD0vR7kZ", False),
        ("", False),
    ],
)
def test_a_credential_is_the_name_of_one(text: str, reference: bool) -> None:
    assert is_reference(text) is reference
