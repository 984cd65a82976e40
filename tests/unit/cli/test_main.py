import io
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import click
import pytest

from rarms_iac import __version__
from rarms_iac.app.use_case_errors import BUG, Outcome, UseCaseError, system_finding
from rarms_iac.cli import entry
from rarms_iac.cli.ending import ExitCode, Interrupted, Interrupts
from rarms_iac.cli.group import COMMANDS
from rarms_iac.cli.session import Session
from rarms_iac.storage.shipped import known_codes
from rarms_iac.views.terminal import Terminal
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


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("drfit", 'Unknown command "drfit". Did you mean "drift"?'),
        ("drift --jsn", "--json"),
        ("drift --jsn", "`rarms drift --help` lists its options."),
        ("--jsn plan", "No such option '--jsn'"),
        ("--json plan", "The option --json belongs to rarms plan: write it after the command."),
        ("-f rarms.yaml plan", "The option -f belongs to rarms plan: write it after the command."),
        ("plan cell.yaml", "Name the manifest with -f: `rarms plan -f cell.yaml`."),
        ("apply --host", "Usage: rarms apply "),
        ("apply --host", "`rarms apply --help`"),
    ],
)
def test_wrong_words_say_the_right_ones(words: str, says: str) -> None:
    answer = rarms(*words.split())

    assert (answer.code, bool(answer.out)) == (64, words.startswith("--json"))
    assert says in answer.err


@pytest.mark.parametrize("words", ["plan cell", "explain vision cell.yaml"])
def test_only_a_manifest_asks_for_its_option(words: str) -> None:
    assert "with -f" not in rarms(*words.split()).err


def test_wrong_usage_is_wrapped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    answer = rarms("plan", "--max-disruption", "none")

    assert answer.code == 64
    assert max(map(len, answer.err.splitlines())) <= 80


@pytest.fixture(autouse=True)
def _signals_as_before() -> Iterator[None]:
    """An interrupted command has its process ignore further signals, which here is the one of all tests."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def run_with(
    error: BaseException, *, debug: bool = False, command: str = "", begun: bool = False
) -> tuple[ExitCode, str]:
    """What becomes of an exception that a command ends with."""
    terminal = Terminal(out=io.StringIO(), err=io.StringIO(), debug=debug)

    def invoke(session: Session, _arguments: Sequence[str]) -> ExitCode:
        if begun:
            with session.interrupts.gently():
                session.interrupts.should_stop()
        raise error

    code = entry.run_guarded(Session(terminal=terminal, command=command), [], invoke)
    assert isinstance(terminal.err, io.StringIO)
    return code, terminal.err.getvalue()


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (click.exceptions.Exit(0), ExitCode.DONE),
        (click.UsageError("no"), ExitCode.USAGE),
        (KeyboardInterrupt(), ExitCode.INTERRUPTED),
        (Interrupted(ExitCode.TERMINATED), ExitCode.TERMINATED),
        (PermissionError(13, "Permission denied", "rarms.yaml"), ExitCode.FAILED),
        (UseCaseError(Outcome.NEGATIVE, [BUG.at(None, "what", "do")]), ExitCode.NO),
        (ZeroDivisionError("division by zero"), ExitCode.FAILED),
        (RecursionError(), ExitCode.FAILED),
        (MemoryError(), ExitCode.FAILED),
    ],
)
def test_every_exception_becomes_exit_code_without_trace(error: BaseException, code: ExitCode) -> None:
    given, said = run_with(error)

    assert given == code
    assert "Traceback" not in said


def test_unforeseen_error_is_a_bug() -> None:
    _, said = run_with(ZeroDivisionError("division by zero"))

    assert said.startswith("error[RARMS199] This is a bug in rarms\n")
    assert "ZeroDivisionError: division by zero" in said
    assert "--debug" in said


def test_debug_shows_the_trace() -> None:
    _, said = run_with(ZeroDivisionError("division by zero"), debug=True)

    assert said.startswith("Traceback (most recent call last):\n")


AGAIN = "If it was changing a host, run the same command again to finish the change"


@pytest.mark.parametrize(
    ("command", "advice"),
    [
        ("apply", f"{AGAIN}, or `rarms undo` to reverse it."),
        ("stop", f"{AGAIN}, or `rarms undo` to reverse it."),
        ("undo", f"{AGAIN}."),
        ("measure", "Results are saved; run the same command to continue."),
        ("prove", "Results are saved; run the same command to continue."),
        ("plan", ""),
    ],
)
def test_an_interrupt_says_how_to_go_on(command: str, advice: str) -> None:
    _, said = run_with(Interrupted(ExitCode.INTERRUPTED), command=command, begun=True)

    assert " ".join(said.split()) == f"rarms was interrupted. {advice}".strip()


@pytest.mark.parametrize(
    ("command", "ending"), [("apply", " Nothing was done."), ("measure", " Nothing was done."), ("plan", "")]
)
def test_interrupt_before_work_says_that_nothing_was_done(command: str, ending: str) -> None:
    _, said = run_with(Interrupted(ExitCode.INTERRUPTED), command=command)

    assert " ".join(said.split()) == f"rarms was interrupted.{ending}"


def test_empty_look_has_begun_nothing() -> None:
    """`apply` first finishes what an earlier run left; where there is none, an interrupt while it plans undoes none."""
    looked, worked = Interrupts(), Interrupts()
    with looked.gently():
        assert looked.begun, "a signal that ends it at once may come upon a change"
    with worked.gently():
        worked.should_stop()
    with worked.gently():
        pass

    assert (looked.begun, worked.begun) == (False, True)


def test_the_file_of_a_refusal_is_named() -> None:
    error = PermissionError(13, "Permission denied", "/a/rarms.yaml")

    assert "/a/rarms.yaml: Permission denied." in system_finding(error).detail


def test_signal_asks_gentle_work_first() -> None:
    heard: list[str] = []
    interrupts = Interrupts(on_request=lambda: heard.append("once"))
    with interrupts.gently():
        interrupts.receive(signal.SIGTERM, None)
        assert interrupts.should_stop()
        with pytest.raises(Interrupted) as second:
            interrupts.receive(signal.SIGINT, None)
    with pytest.raises(Interrupted) as first:
        Interrupts().receive(signal.SIGTERM, None)

    assert (first.value.code, second.value.code) == (ExitCode.TERMINATED, ExitCode.INTERRUPTED)
    assert heard == ["once"]


def test_listening_takes_signals_over_and_gives_them_back() -> None:
    before = signal.getsignal(signal.SIGINT)
    interrupts = Interrupts()
    with interrupts.listening(), interrupts.gently():
        signal.raise_signal(signal.SIGINT)
        assert interrupts.exit_code is ExitCode.INTERRUPTED

    assert signal.getsignal(signal.SIGINT) is before


def test_further_interrupt_cuts_no_last_words() -> None:
    with pytest.raises(Interrupted), Interrupts().listening():
        signal.raise_signal(signal.SIGINT)

    signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN


BASH = shutil.which("bash")
needs_bash = pytest.mark.needs("bash")


@pytest.fixture
def complete(monkeypatch: pytest.MonkeyPatch):  # type: ignore[no-untyped-def]  # a function of words
    """What is offered for the last word, as PowerShell's script asks."""

    def ask(*words: str) -> list[str]:
        monkeypatch.setenv("_RARMS_COMPLETE", "powershell_complete")
        monkeypatch.setenv("COMP_WORDS", "\n".join(words[:-1]))
        monkeypatch.setenv("COMP_CWORD", words[-1])
        return [line.partition("\t")[0] for line in rarms().lines if line]

    return ask


def test_commands_options_and_choices_are_completed(complete) -> None:  # type: ignore[no-untyped-def]
    assert complete("dri") == ["drift"]
    assert complete("") == list(COMMANDS)
    assert complete("--ver") == ["--version"]
    assert complete("schema", "--de") == ["--debug"]
    assert complete("completion", "po") == ["powershell"]
    assert complete("validate", "--output", "s") == ["sarif"]
    assert complete("plan", "--max-disruption", "l") == ["live"]
    assert complete("explain", "RARMS01") == [code for code in known_codes() if code.startswith("RARMS01")]


def test_names_are_those_of_the_manifest(tmp_path: Path, complete) -> None:  # type: ignore[no-untyped-def]
    (tmp_path / "rarms.yaml").write_text(
        "hosts:\n  onboard: {}\ncomponents:\n    # the eyes\n    vision:\n        criticality: 3\n    video: {}\n"
        "partitions:\n  vault: {}\n",
        encoding="utf-8",
        newline="\n",
    )

    for manifest in (str(tmp_path), str(tmp_path / "rarms.yaml")):
        assert complete("measure", "-f", manifest, "v") == ["vision", "video"]
        assert complete("plan", "--manifest", manifest, "--host", "") == ["onboard"]


@pytest.mark.parametrize(
    "words", [("measure", "-f", "nothing-here", "v"), ("measure", "--nonsense", "x", "-f", "-", "v")]
)
def test_what_cannot_be_read_offers_nothing(words: tuple[str, ...], complete) -> None:  # type: ignore[no-untyped-def]
    assert complete(*words) == []


@needs_bash
def test_the_bash_script_asks_rarms(tmp_path: Path) -> None:
    program = tmp_path / "rarms"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m rarms_iac.cli.main "$@"\n', encoding="utf-8")
    program.chmod(0o755)
    script = rarms("completion", "bash").out
    ask = f'{script}\nCOMP_WORDS=(rarms dri); COMP_CWORD=1; _rarms_completion rarms; printf "%s\\n" "${{COMPREPLY[@]}}"'
    environment = {**os.environ, "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": str(CHECKOUT)}

    shown = subprocess.run(
        [str(BASH), "--norc", "-c", ask], capture_output=True, text=True, check=True, env=environment
    )

    assert (shown.stdout, shown.stderr) == ("drift\n", "")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish", "powershell"])
def test_completion_script_only_asks_rarms(shell: str) -> None:
    script = rarms("completion", shell).out

    assert "_RARMS_COMPLETE" in script and f"{shell}_complete" in script  # noqa: PT018
    assert "components" not in script


def test_completing_a_command_imports_no_command() -> None:
    script = (
        "import sys; from rarms_iac.cli.main import main; main([]); "
        "print([m for m in sys.modules if m.startswith(('rarms_iac.cli.commands.', 'yaml', 'pydantic', 'rich'))])"
    )
    asked = {**os.environ, "_RARMS_COMPLETE": "powershell_complete", "COMP_CWORD": "dri"}

    shown = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, env=asked)

    assert shown.stdout.splitlines()[-1] == "[]"


def test_missing_shell_lists_the_known_ones() -> None:
    answer = rarms("completion")

    assert answer.code == 64
    assert "Choose from: bash, zsh, fish, powershell." in " ".join(answer.err.split())
