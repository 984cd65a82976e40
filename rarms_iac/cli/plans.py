"""Plan files that a user names."""

from pathlib import Path

from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.files import read_file
from rarms_iac.cli.problems import Halted
from rarms_iac.manifest.load import manifest_path
from rarms_iac.model.plan import Plan
from rarms_iac.storage.plan_file import MAX_BYTES, PlanFileError, read_plan


def read_plan_file(path: str) -> Plan:
    """The plan of this file.

    Raises:
        Halted: the file cannot be read (1), is no plan or was edited (3).
    """
    try:
        return read_plan(read_file(path, MAX_BYTES, "rarms plan --out FILE"))
    except PlanFileError as error:
        raise Halted(
            ExitCode.REFUSED, [error.finding.at(None, f"{path}: {error.says}.", f"{error.advice}.")]
        ) from error


def folder_of(plan: Plan) -> str:
    """Where simulated hosts lie for who applies the plan: beside its manifest, as seen from here."""
    return "." if plan.manifest == "-" else str(Path(manifest_path(plan.manifest)).parent)
