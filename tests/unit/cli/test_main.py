import subprocess
import sys
from pathlib import Path

import pytest

from rarms_iac import __version__
from rarms_iac.cli.table import COMMANDS
from tests.needs import CHECKOUT
from tests.unit.cli.running import rarms


def test_the_version_is_one_line() -> None:
    assert rarms("--version").out == f"rarms {__version__}\n"
    assert rarms("--no-color", "--version").out == f"rarms {__version__}\n"


def test_the_version_imports_nothing_else() -> None:
    script = (
        "import sys; from rarms_iac.cli.main import main; main(['--version']); "
        "print(sorted(m for m in sys.modules if m.startswith(('click', 'rarms_iac', 'yaml', 'pydantic'))))"
    )

    shown = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout

    modules = ["rarms_iac", "rarms_iac.cli", "rarms_iac.cli.main", "rarms_iac.model", "rarms_iac.model.version"]
    assert shown.splitlines()[1] == str(modules)


def test_help_lists_every_command_and_imports_none() -> None:
    script = (
        "import sys; from rarms_iac.cli.main import main; code = main(['--help']); "
        "print([m for m in sys.modules if m.startswith(('rarms_iac.cli.commands.', 'yaml', 'pydantic', 'rich'))])"
    )

    shown = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout

    assert shown.splitlines()[-1] == "[]"
    assert all(f"  {name} " in shown for name in COMMANDS)


def test_what_a_program_reads_imports_no_rich(tmp_path: Path) -> None:
    commands = (
        *(f"validate --output {form}" for form in ("json", "sarif", "junit", "github")),
        *("plan --json", "plan --output sarif", "status --json", "drift --json", "history --json", "doctor --json"),
        *("graph", "explain vision --json", "schema manifest", "completion bash", "fmt --check"),
    )
    (tmp_path / "rarms.yaml").write_text(
        "schema: rarms/v1\napplication: { name: robot }\n"
        "hosts: { onboard: { logical_processors: 2, memory: 4 GiB } }\n"
        "components: { vision: { criticality: 1, memory: 512 MiB, cpu: { reserve: 40 % } } }\n",
        encoding="utf-8",
        newline="\n",
    )
    script = (
        f"import sys; sys.path.insert(0, {str(CHECKOUT)!r}); from rarms_iac.cli.main import main\n"
        f"codes = [main(words.split()) for words in {commands}]\n"
        "print(codes, [name for name in sys.modules if name.partition('.')[0] == 'rich'])\n"
    )

    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=tmp_path)

    assert ran.stdout.splitlines()[-1] == "[0, 0, 0, 0, 0, 0, 0, 5, 0, 0, 0, 0, 0, 0, 0] []", ran.stderr


INTERRUPTED_IN_AN_IMPORT = """
import signal, sys
class Finder:
    def find_spec(self, name, *_):
        if name == "rarms_iac.cli.entry":
            signal.raise_signal(signal.SIGINT)
sys.meta_path.insert(0, Finder())
"""
INTERRUPTED_IN_THE_LAST_FLUSH = """
import signal
from rarms_iac.views.terminal import Terminal
Terminal.flush = lambda self: signal.raise_signal(signal.SIGINT)
"""


@pytest.mark.parametrize("interrupt", [INTERRUPTED_IN_AN_IMPORT, INTERRUPTED_IN_THE_LAST_FLUSH])
def test_an_interrupt_outside_the_command_is_one_line(interrupt: str) -> None:
    heard = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"  # also where a runner ignores it
    script = f"{heard}\n{interrupt}\nimport sys; from rarms_iac.cli.main import main; sys.exit(main(['schema']))"

    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)

    assert (ended.returncode, ended.stderr) == (130, "rarms was interrupted.\n")


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_command_explains_itself_in_80_columns(name: str) -> None:
    answer = rarms(name, "--help")

    assert answer.code == 0
    assert answer.lines[0].startswith(f"Usage: rarms {name} ")
    assert max(map(len, answer.lines)) <= 80


@pytest.mark.parametrize("words", [(), ("plan",)])
def test_help_has_a_short_form(words: tuple[str, ...]) -> None:
    short, long = rarms(*words, "-h"), rarms(*words, "--help")

    assert (short.code, short.out) == (0, long.out)


def test_misspelt_command_is_wrong_usage_and_offers_nearest() -> None:
    answer = rarms("drfit")

    assert answer.code == 64
    assert answer.out == ""
    assert 'There is no command "drfit". Did you mean "drift"?' in answer.err


def test_a_misspelt_option_offers_the_nearest() -> None:
    answer = rarms("drift", "--jsn")

    assert answer.code == 64
    assert "--json" in answer.err
    assert "`rarms drift --help` lists what it takes." in answer.err


@pytest.mark.parametrize("words", [("--json", "plan"), ("-f", "rarms.yaml", "plan")])
def test_option_before_command_is_told(words: tuple[str, ...]) -> None:
    answer = rarms(*words)

    assert answer.code == 64
    assert f"The option {words[0]} belongs to rarms plan: write it after the command." in answer.err
    assert "No such option '--jsn'" in rarms("--jsn", "plan").err


def test_manifest_needs_its_option() -> None:
    answer = rarms("plan", "cell.yaml")

    assert answer.code == 64
    assert "Name the manifest with -f: `rarms plan -f cell.yaml`." in answer.err
    assert "with -f" not in rarms("plan", "cell").err
    assert "with -f" not in rarms("explain", "vision", "cell.yaml").err


def test_option_without_value_is_told() -> None:
    answer = rarms("apply", "--host")

    assert answer.code == 64
    assert answer.err.startswith("Usage: rarms apply ")
    assert "`rarms apply --help`" in answer.err


def test_wrong_usage_is_wrapped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    answer = rarms("plan", "--max-disruption", "none")

    assert answer.code == 64
    assert max(map(len, answer.err.splitlines())) <= 80
