import pytest

from rarms_iac.model.commands import (
    APPLY,
    DRIFT,
    PLAN_OUT,
    Prose,
    RecommendedCommand,
    command,
    plain_text,
    prose,
    sentences,
)


def test_command_is_data_until_it_is_written_out() -> None:
    measure = command("measure", "vision", again=True, script=False, samples=200, from_="10%")

    assert measure.arguments == ("vision",)
    assert [(option.name, option.value) for option in measure.options] == [
        ("--again", None),
        ("--samples", "200"),
        ("--from", "10%"),
    ]
    assert measure.text == "rarms measure vision --again --samples 200 --from 10%"
    assert command("apply", "my plan.json", f="robot").text == "rarms apply 'my plan.json' -f robot"


@pytest.mark.parametrize(
    ("recommended", "written"),
    [
        (DRIFT, "`rarms drift -f cell`"),
        (PLAN_OUT, "`rarms plan --out FILE -f cell`"),
        (command("explain", "RARMS014"), "`rarms explain RARMS014`"),
        (command("apply", "FILE"), "`rarms apply FILE`"),
        (command("plan", f="robot"), "`rarms plan -f robot`"),
    ],
)
def test_command_names_the_manifest_if_it_takes_one(recommended: RecommendedCommand, written: str) -> None:
    assert plain_text(prose("Look: ", recommended, "."), " -f cell") == f"Look: {written}."


def test_text_and_commands_are_joined_piece_by_piece() -> None:
    either = prose(APPLY, " finishes it")

    assert sentences("It stopped.", "", prose("Run it: ", either, ".")) == Prose(
        ("It stopped. Run it: ", APPLY, " finishes it.")
    )
    assert sentences("It stopped.", prose("Wait", ".")) == Prose(("It stopped. Wait.",))
    assert not sentences("", "")
