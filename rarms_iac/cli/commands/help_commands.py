"""What helps to use rarms: `rarms explain`, `schema` and `completion`."""

import re
from collections.abc import Iterator

import click

from rarms_iac.app.requests import ManifestSource
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.group import root_group
from rarms_iac.cli.options import json_option, manifest_options
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.cli.table import COMMANDS
from rarms_iac.storage.finding_pages import code_of, finding_page, is_code, known_codes
from rarms_iac.storage.shipped import shipped_text
from rarms_iac.views.completion import CommandShape, OptionShape, Shell, completion_script
from rarms_iac.views.explain import page_text, unknown_code
from rarms_iac.views.finding_forms import OutputFormat
from rarms_iac.views.json_output import json_of
from rarms_iac.views.output.common import ExplanationOutput


@rarms_command("explain")
@click.argument("subject", metavar="FINDING|COMPONENT")
@click.option("--guide", is_flag=True, help="Show how to set COMPONENT up by hand: Hyper-V, MMCSS, Linux, in order.")
@manifest_options
@json_option
def explain_command(session: Session, *, subject: str, guide: bool, source: ManifestSource, as_json: bool) -> ExitCode:
    """Say what a finding means and how to mend it, or how a component comes to what it gets.

    FINDING is the id that stands before it, such as RARMS014; its number alone is enough. COMPONENT is one of the
    manifest: from its APT over the data log to the per cent that its partition gets, and what was rejected, as
    `rarms plan` has it: hosts are looked at where they can be. With
    --guide: what to set by hand for it, where, and in which order, where it cannot be changed to read a
    configuration. Exit code 4 where nothing says how much the component needs, or where everything does not fit.
    """
    if guide:
        text = _guide(source, subject)
        session.terminal.data(json_of(ExplanationOutput(subject=subject, page=text)) if as_json else text)
        return ExitCode.DONE
    if is_code(subject):
        return _finding(session, subject, as_json=as_json)
    return _component(session, source, subject, as_json=as_json)


def _component(session: Session, source: ManifestSource, name: str, *, as_json: bool) -> ExitCode:
    from rarms_iac.app.explain import explain_component
    from rarms_iac.app.manifests import load_manifest
    from rarms_iac.cli.messages import tell
    from rarms_iac.views.explain import explanation_json, explanation_text

    manifest = load_manifest(source)
    explained = explain_component(manifest, name)
    tell(session.terminal, explained.errors, manifest.sources)
    if as_json:
        session.terminal.data(explanation_json(explained.explanation))
    else:
        session.terminal.show(explanation_text(explained.explanation, without_errors=bool(explained.errors)))
    return ExitCode.DONE if explained.fits else ExitCode.NO


def _guide(source: ManifestSource, name: str) -> str:
    from rarms_iac.app.guide import guide_facts
    from rarms_iac.app.manifests import load_manifest
    from rarms_iac.views.explain import guide

    return guide(guide_facts(load_manifest(source), name))


def _finding(session: Session, finding: str, *, as_json: bool) -> ExitCode:
    code = code_of(finding)
    page = finding_page(code)
    if page is None:
        raise click.UsageError(unknown_code(finding), click.get_current_context())
    if as_json:
        session.terminal.data(json_of(ExplanationOutput(subject=code, page=page)))
    else:
        session.terminal.show(page_text(page))
    return ExitCode.DONE


SCHEMAS = ("manifest", "overlay", "plan", "snapshot", "output", "datalog")


@rarms_command("schema")
@click.argument(
    "name", type=click.Choice(SCHEMAS), default="manifest", metavar="[manifest|overlay|plan|snapshot|output|datalog]"
)
def schema_command(session: Session, *, name: str) -> ExitCode:
    """Print a JSON Schema: of a manifest, an overlay, a plan, a snapshot, what --json prints, or a line of a data log.

    An editor that knows the manifest's schema completes keys and shows what each is for.
    """
    session.terminal.data(shipped_text(f"schemas/{name}.json"))
    return ExitCode.DONE


@rarms_command("completion")
@click.argument("shell", type=click.Choice([shell.value for shell in Shell]))
def completion_command(session: Session, *, shell: str) -> ExitCode:
    """Print a completion script for a shell, to be sourced or saved.

    It completes commands, options and their fixed values, and starts no Python for that.
    """
    session.terminal.data(completion_script(Shell(shell), top_shape(), command_shapes()))
    return ExitCode.DONE


HELP_OPTION = OptionShape(flags=("-h", "--help"), help="Show this message and exit.")


def top_shape() -> tuple[OptionShape, ...]:
    """The options of `rarms` itself."""
    return (*_options(root_group()), HELP_OPTION)


def command_shapes() -> tuple[CommandShape, ...]:
    """Every command, in the table's order. Imports them all."""
    return tuple(_shape(name, command) for name, command in all_commands())


def all_commands() -> Iterator[tuple[str, click.Command]]:
    """Every command with its name, in the table's order. Imports them all."""
    group = root_group()
    context = click.Context(group, info_name="rarms")
    for name in COMMANDS:
        command = group.get_command(context, name)
        assert command is not None, f"the table names {name}, and there is no such command"
        yield name, command


def _shape(name: str, command: click.Command) -> CommandShape:
    arguments = [parameter for parameter in command.params if isinstance(parameter, click.Argument)]
    called = " ".join(f"{argument.name} {argument.metavar}" for argument in arguments)
    return CommandShape(
        name=name,
        help=COMMANDS[name],
        options=(*_options(command), HELP_OPTION),
        words=tuple(word for argument in arguments for word in _choices(argument)),
        # a partition has the name of its most critical component
        takes_names=re.search("component|partition", called, re.IGNORECASE) is not None,
    )


def _options(command: click.Command) -> tuple[OptionShape, ...]:
    return tuple(
        OptionShape(
            flags=(*parameter.opts, *parameter.secondary_opts),
            help=" ".join((parameter.help or "").split()),
            takes_value=not parameter.is_flag,
            choices=_choices(parameter),
        )
        for parameter in command.params
        if isinstance(parameter, click.Option)
    )


def _choices(parameter: click.Parameter) -> tuple[str, ...]:
    if parameter.metavar == "FINDING|COMPONENT":
        return known_codes()
    if parameter.metavar == "FORMAT[=FILE]":
        return tuple(OutputFormat)
    return tuple(map(str, parameter.type.choices)) if isinstance(parameter.type, click.Choice) else ()
