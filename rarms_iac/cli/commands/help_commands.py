"""What helps to use rarms: `rarms explain`, `schema` and `completion`."""

from dataclasses import dataclass
from typing import Literal

from rarms_iac.app.requests import ManifestSource, argument, flag
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.cli.command import rarms_command
from rarms_iac.cli.completion import completion_script
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.session import Session
from rarms_iac.storage.shipped import FindingPage, code_of, finding_page, is_code, shipped_text
from rarms_iac.views.findings_text import page_text, unknown_code
from rarms_iac.views.json_output import json_of


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplainOptions:
    """Options of `rarms explain` alone."""

    subject: str = argument("FINDING|COMPONENT")
    guide: bool = flag("--guide", help="Show the manual steps for COMPONENT on Hyper-V, in MMCSS and on Linux.")


@rarms_command("explain")
def explain_command(session: Session, options: ExplainOptions, source: ManifestSource) -> ExitCode:
    """Explain a finding, or the reservation of a component.

    FINDING is an id such as RARMS014; its number alone is enough. COMPONENT is a component of the manifest: the table
    has its thresholds, measured values, reservation and host, each with its source, and the rejected alternatives.
    rarms looks at the hosts if it can reach them. --guide shows the settings to make by hand for a component that
    cannot read a configuration. Exit code 4: the reservation is not known, or the components do not fit.
    """
    subject = options.subject
    if options.guide:
        return _guide(session, source, subject)
    if is_code(subject):
        return _finding(session, subject)
    return _component(session, source, subject)


def _component(session: Session, source: ManifestSource, name: str) -> ExitCode:
    from rarms_iac.app.explain import explain_component
    from rarms_iac.app.manifests import load_manifest
    from rarms_iac.cli.messages import tell
    from rarms_iac.views.explain import explanation_text

    manifest = load_manifest(source)
    explained = explain_component(manifest, name)
    tell(session.terminal, explained.errors, manifest.sources)
    session.answer(lambda: json_of(explained), lambda: explanation_text(explained))
    return ExitCode.DONE if explained.fits else ExitCode.NO


def _guide(session: Session, source: ManifestSource, name: str) -> ExitCode:
    from rarms_iac.app.guide import guide_facts
    from rarms_iac.app.manifests import load_manifest
    from rarms_iac.views.explain import guide_text

    facts = guide_facts(load_manifest(source), name)
    session.answer(lambda: json_of(facts), lambda: guide_text(facts))
    return ExitCode.DONE


def _finding(session: Session, finding: str) -> ExitCode:
    code = code_of(finding)
    page = finding_page(code)
    if page is None:
        raise RequestError(unknown_code(finding))
    session.answer(lambda: json_of(FindingPage(subject=code, page=page)), lambda: page_text(page))
    return ExitCode.DONE


@dataclass(frozen=True, slots=True, kw_only=True)
class SchemaOptions:
    """Options of `rarms schema` alone."""

    name: Literal["manifest", "overlay", "plan", "snapshot", "output", "datalog"] = argument(
        "[manifest|overlay|plan|snapshot|output|datalog]", default="manifest"
    )


@rarms_command("schema", json=False)
def schema_command(session: Session, options: SchemaOptions) -> ExitCode:
    """Print a JSON Schema: of a manifest, an overlay, a plan, a snapshot, the output of --json, or a data log's line.

    With the schema of the manifest, an editor completes and describes keys.
    """
    session.terminal.data(shipped_text(f"schemas/{options.name}.json"))
    return ExitCode.DONE


@dataclass(frozen=True, slots=True, kw_only=True)
class CompletionOptions:
    """For which shell."""

    shell: Literal["bash", "zsh", "fish", "powershell"] = argument()


@rarms_command("completion", json=False)
def completion_command(session: Session, options: CompletionOptions) -> ExitCode:
    """Print a completion script for a shell: bash, zsh, fish or PowerShell.

    When you press Tab, the script asks rarms for commands, options and their values, and for the components and hosts
    of the manifest. Write the line of your shell into its startup file:

    bash: source <(rarms completion bash)

    zsh: source <(rarms completion zsh)

    fish: rarms completion fish | source

    PowerShell: rarms completion powershell | Out-String | Invoke-Expression
    """
    session.terminal.data(completion_script(options.shell))
    return ExitCode.DONE
