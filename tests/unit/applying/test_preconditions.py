"""What another robot has on a host is refused by its name."""

import pytest

from rarms_iac.applying.preconditions import marks_of_other_robots
from rarms_iac.model.state import Responsiveness, State, TaskClass, TaskRecord
from rarms_iac.model.system import Application
from tests.builders_plan import facts


def _record(robot: str, application: str = "cell") -> TaskRecord:
    return TaskRecord(application=application, robot=robot, set="a" * 12, before=None)


@pytest.mark.parametrize(
    ("robot", "own", "refused"),
    [("robot-7", "robot-8", 2), ("robot-7", "", 2), ("", "robot-8", 0), ("robot-8", "robot-8", 0)],
)
def test_records_of_another_robot_are_refused(robot: str, own: str, refused: int) -> None:
    host = State(
        facts=facts(),
        tasks=(
            TaskClass(name="MotionControl", record=_record(robot)),
            TaskClass(name="Games", record=_record("robot-9", "kiosk")),
        ),
        responsiveness=Responsiveness(record=_record(robot)),
    )

    found = list(marks_of_other_robots([host], Application(name="cell", robot=own)))

    assert [finding.address for finding in found] == ["task/MotionControl", "mmcss/responsiveness"][:refused]
    assert all(finding.values["robot"] == robot and f'"{robot}"' in str(finding) for finding in found)
