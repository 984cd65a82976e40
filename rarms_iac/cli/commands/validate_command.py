"""`rarms validate`: report every mistake of a manifest at once, without a host."""

import click

from rarms_iac.app.requests import ManifestSource
from rarms_iac.app.validation import sources_in, validate
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.messages import write_outputs
from rarms_iac.cli.options import manifest_options, output_option
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.views.finding_forms import OutputTarget, findings_as


@rarms_command("validate")
@click.argument("files", nargs=-1, metavar="[FILE]...")
@manifest_options
@click.option("--strict", is_flag=True, help="End with exit code 2 for warnings, too.")
@output_option
def command(
    session: Session, *, files: tuple[str, ...], source: ManifestSource, strict: bool, outputs: tuple[OutputTarget, ...]
) -> ExitCode:
    """Check manifests and say everything that is wrong or odd at once.

    FILE is a manifest, an overlay (it is checked with the rarms.yaml beside or above it), a folder with any number of
    both, or - for standard input; without, it is what --manifest names. No host is asked, and no program is started.
    Errors end with exit code 2; warnings and notes do not.
    """
    checked = validate(sources_in(files or (source.manifest,), source))
    write_outputs(
        session.terminal,
        outputs,
        lambda form: findings_as(form, checked.findings, checked.sources, accepted=checked.accepted),
    )
    return ExitCode.FOUND if checked.fails(strict=strict) else ExitCode.DONE
