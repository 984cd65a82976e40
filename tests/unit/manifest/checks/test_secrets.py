import pytest

from rarms_iac.manifest.checks.secrets import is_reference
from rarms_iac.model.run import FromEnvironment
from rarms_iac.model.system import Guest
from tests.builders import a_component, a_partition, a_run, a_system
from tests.unit.manifest.checks.violations import details, found


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


def test_secrets_do_not_stand_in_the_manifest() -> None:
    guest = Guest(credential="Tr0ub4dor&3")
    written = a_run(environment={"CAMERA_PASSWORD": "opensesame", "CAMERA": "front"})
    taken = a_run(environment={"CAMERA_PASSWORD": FromEnvironment(name="CAMERA_PASSWORD")})

    assert found(a_system(partitions=[a_partition("vision", guest=guest)])) == [
        ("RARMS090", "partitions.vision.guest.credential")
    ]
    assert found(a_system(components=[a_component(run=written)])) == [
        ("RARMS091", "components.vision.run.environment.CAMERA_PASSWORD")
    ]
    assert found(a_system(components=[a_component(run=taken)])) == []


def test_no_finding_shows_the_secret() -> None:
    system = a_system(partitions=[a_partition("vision", guest=Guest(credential="Tr0ub4dor&3"))])

    assert "Tr0ub4dor" not in details(system)
