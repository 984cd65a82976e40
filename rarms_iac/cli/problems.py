"""What goes wrong at the rim of the command, as findings; and how a command ends early."""

from collections.abc import Sequence

from rarms_iac.cli.codes import ExitCode
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.views.diagnostics import Sources

IN_THE_WAY = Finding(code="RARMS176", severity=Severity.ERROR, summary="A file is in the way")
DECLINED = Finding(code="RARMS174", severity=Severity.NOTE, summary="Nothing was changed")
NOT_READ = Finding(code="RARMS173", severity=Severity.ERROR, summary="A file could not be read")
NOT_WRITTEN = Finding(code="RARMS177", severity=Severity.ERROR, summary="A file could not be written")
SYSTEM_REFUSED = Finding(code="RARMS178", severity=Severity.ERROR, summary="The operating system refused something")
USAGE = Finding(code="RARMS179", severity=Severity.ERROR, summary="The command cannot be done as it is given")
OUT_OF_REACH = Finding(code="RARMS198", severity=Severity.ERROR, summary="This host cannot be reached by this version")
BUG = Finding(code="RARMS199", severity=Severity.ERROR, summary="This is a bug in rarms")


class Halted(Exception):
    """The command ends here, for these reasons and with this exit code."""

    def __init__(
        self,
        code: ExitCode,
        diagnostics: Sequence[Diagnostic],
        sources: Sources | None = None,
        *,
        certificate: str = "",
    ) -> None:
        super().__init__("; ".join(diagnostic.summary for diagnostic in diagnostics))
        self.code = code
        self.diagnostics = tuple(diagnostics)
        self.sources = sources or {}
        self.certificate = certificate  # that no layout exists, for programs


def bug(error: BaseException) -> Diagnostic:
    """An exception that nobody foresaw."""
    says = " ".join(str(error).split())
    return BUG.at(
        None,
        f"{type(error).__name__}: {says[:300]}" if says else type(error).__name__,
        "Run the same command with --debug: the trace it shows is what a report of the bug needs.",
    )


def misused(says: str, command: str) -> Diagnostic:
    """Words that do not fit the command, for a program that reads findings; a person is told the usage."""
    return USAGE.at(None, says, f"`{command} --help` lists what it takes.")


def system_refused(error: OSError) -> Diagnostic:
    """A file or a call that the operating system would not do, and no command told better."""
    where = f"{error.filename}: " if error.filename else ""
    return SYSTEM_REFUSED.at(
        None,
        f"{where}{error.strerror or error}.",
        "Look at the path, its rights and the space on its disk; --debug shows where it happened.",
    )


def in_the_way(path: str) -> Diagnostic:
    """What is to be written anew exists already."""
    return IN_THE_WAY.at(
        None, f"{path} exists already, and stays as it is.", "Name another folder, or move that file away first."
    )


def not_written(path: str, error: OSError) -> Diagnostic:
    """A file that was asked for with an option."""
    return NOT_WRITTEN.at(
        None, f"{path}: {error.strerror or error}.", "Name a file in a folder that exists and that you may write to."
    )


def not_read(path: str, says: str, advice: str) -> Diagnostic:
    """A file that was named as a plan or a snapshot."""
    return NOT_READ.at(None, f"{path}: {says}.", advice)


def declined() -> Diagnostic:
    """The question was not answered with yes."""
    return DECLINED.at(
        None,
        "The answer was not `yes`.",
        "Run it again to be asked again; `rarms plan` shows the changes and asks nothing.",
    )


def out_of_reach(host: str, provider: str) -> Diagnostic:
    """A provider that the manifest may name, and that this version cannot observe or change."""
    return OUT_OF_REACH.at(
        None,
        f"{host} has the provider {provider}: this version reaches simulated hosts only.",
        f"Its manifest can be checked (`rarms validate`) and planned from a snapshot "
        f"(`rarms plan --snapshot {host}=FILE`); `provider: simulated` tries the same layout without the machine.",
        address=f"host/{host}",
    )
