from pathlib import Path

import pytest

from scripts.check_style import PACKAGE, breaches_elsewhere, breaches_in

READS = "this reads a sentence: what code needs is a field"


@pytest.mark.parametrize(
    "planted",
    [
        'finding.message.removeprefix("it is held by ")',
        'str(finding.advice).replace("at most", "<=")',
        '"rarms plan" in finding.advice',
        're.search("[0-9]+ %", finding.detail)',
        'pattern.sub("", f"{finding.summary}.")',
        'step.comment.split("; ")[1]',
        'show_threshold(index, threshold).partition(" ")',
        '(change.reason + ".").startswith("asked")',
        'render(text).endswith("done")',
        'attribute.note.startswith("forces")',
        'answer.message.rstrip(".")',
        "finding.summary.lower()",
        'finding.summary == "It does not fit"',
    ],
)
def test_code_that_reads_a_sentence_is_found(tmp_path: Path, planted: str) -> None:
    (tmp_path / "views").mkdir()
    (tmp_path / "views" / "plan.py").write_text(f"value = {planted}\n", encoding="utf-8")

    assert [breach.partition(": ")[2] for breach in breaches_in(tmp_path) if "views/plan.py" in breach] == [READS]


TYPED = """
class Remark:
    hint: Wording
    parts: tuple[Prose, ...]

def hint_of(remark: Remark) -> Prose | None: ...

def plan_text(plan: Plan) -> "RenderableType": ...

def amount(settings: Settings) -> str:
    return show_processors(settings.reserve)

def shown(remark: Remark, given: Wording) -> bool:
    said = remark.detail
    try:
        if words := remark.hint:
            return {planted}
    except UnreachableError as error:
        return {planted}
"""


@pytest.mark.parametrize(
    "planted",
    [
        'remark.hint.startswith("Run")',
        '"plan" in str(hint_of(remark))',
        'amount(settings).removesuffix(" LP")',
        'given.split("; ")',
        'said.endswith(".")',
        'words.replace("at", "")',
        '"refused" in str(error)',
        'str(plan_text(plan)).count("LP")',
    ],
)
def test_a_sentence_is_known_by_its_type_and_through_a_variable(tmp_path: Path, planted: str) -> None:
    (tmp_path / "plan.py").write_text(TYPED.format(planted=planted), encoding="utf-8")

    found = [breach.partition(": ")[2] for breach in breaches_in(tmp_path) if "plan.py" in breach]
    assert set(found) == {READS}


@pytest.mark.parametrize(
    "planted",
    [
        'line.startswith("ready")',
        "replace(finding, detail=detail)",
        'f"{finding.detail} {finding.advice}"',
        "code in CODES",
        'finding.detail.replace("\\n", " ")',
    ],
)
def test_what_others_print_and_text_that_is_made_is_no_breach(tmp_path: Path, planted: str) -> None:
    (tmp_path / "plan.py").write_text(f"value = {planted}\n", encoding="utf-8")

    assert [breach for breach in breaches_in(tmp_path) if "plan.py" in breach] == []


def test_the_package_reads_no_sentence() -> None:
    assert [breach for breach in breaches_in(PACKAGE) if READS in breach] == []


def test_a_pronoun_is_asked_who_or_what_it_is(tmp_path: Path) -> None:
    (tmp_path / "host.py").write_text("# as no run did\n# Nobody looked, wherever it lies\n", encoding="utf-8")

    found = [breach for breach in breaches_in(tmp_path) if "host.py" in breach]
    assert [breach.partition("host.py:")[2] for breach in found] == [
        "2: `Nobody`: say who or what it is",
        "2: `wherever`: say who or what it is",
    ]


def test_a_test_has_pronouns_in_its_data_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "tests").mkdir()
    written = 'def look() -> str:\n    """As {} does."""\n    return "nobody"  # {}\n'
    (tmp_path / "tests" / "looks.py").write_text(written.format("anybody", "no run"), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert list(breaches_elsewhere()) == []

    (tmp_path / "tests" / "looks.py").write_text(written.format("somebody", "whatever it is"), encoding="utf-8")
    assert list(breaches_elsewhere()) == [
        "tests/looks.py:2: `somebody`: say who or what it is",
        "tests/looks.py:3: `whatever`: say who or what it is",
    ]


PROTOCOL = """
class Sampler(Protocol):
    def sample(self) -> int:
        \"\"\"Return the newest sample in milliseconds.\"\"\"

class Simulated:
    def sample(self) -> int:
        {docstring}return 1
"""


def test_what_a_protocol_promises_is_said_once(tmp_path: Path) -> None:
    sampler = tmp_path / "sampler.py"
    sampler.write_text(PROTOCOL.format(docstring=""), encoding="utf-8")
    assert [breach for breach in breaches_in(tmp_path) if "sampler.py" in breach] == []

    sampler.write_text(PROTOCOL.format(docstring='"""See `Sampler.sample`: always one."""; '), encoding="utf-8")
    (tmp_path / "lone.py").write_text("class Lone:\n    def halve(self) -> None: ...\n", encoding="utf-8")
    found = [breach.partition(": ")[2] for breach in breaches_in(tmp_path) if tmp_path.as_posix() in breach]
    assert found == [
        "halve: it has no docstring, nor has a protocol",
        "sample: its docstring only refers to another: say what it is",
    ]


@pytest.mark.parametrize(
    ("function", "missing"),
    [
        ("def wait(timeout: int) -> Host:", ["its docstring has no Args"]),
        ("def share(host: Host) -> tuple[int, ...]:", ["its docstring has no Returns"]),
        ("def host_of(experiment: Experiment, states: Mapping[str, State]) -> Host:", []),
        ("def never(_name: str) -> bool:", []),
    ],
)
def test_a_number_has_a_contract_and_a_type_of_the_package_says_its_own(
    tmp_path: Path, function: str, missing: list[str]
) -> None:
    (tmp_path / "app").mkdir()
    (tmp_path / "app" / "host.py").write_text(f'{function}\n    """What it is."""\n', encoding="utf-8")

    found = [breach.rpartition(": ")[2] for breach in breaches_in(tmp_path) if "app/host.py" in breach]
    assert found == missing


@pytest.mark.parametrize(("named", "missing"), [("timeout", []), ("host", ["its docstring has no Args"])])
def test_what_no_type_says_of_a_parameter_the_docstring_does(tmp_path: Path, named: str, missing: list[str]) -> None:
    (tmp_path / "app").mkdir()
    docstring = f'"""Return it.\n\n    Args:\n        {named}: in seconds.\n    """'
    function = f"def wait(host: Host, timeout: int) -> Host:\n    {docstring}\n"
    (tmp_path / "app" / "host.py").write_text(function, encoding="utf-8")

    assert [breach.rpartition(": ")[2] for breach in breaches_in(tmp_path) if "app/host.py" in breach] == missing
