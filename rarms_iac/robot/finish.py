"""Finishes the runs that this version began on this machine: `python -I -m rarms_iac.robot.finish`, as root.

`rarms install` of another version calls it before it switches versions. So this call does not change between versions:
no words, no input, findings on standard error, and exit code 0 if no run of this version is left unfinished.
"""

import sys

from rarms_iac.app.applying import finish_runs
from rarms_iac.app.hosts import host_errors
from rarms_iac.app.use_case_errors import RequestError, UseCaseError
from rarms_iac.app.wiring import unfinished_hosts_here
from rarms_iac.applying.run_report import RunEnding
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.version import __version__
from rarms_iac.robot.__main__ import SETTINGS_FILE, refuse_writable_code, set_environment


def main() -> int:
    """Finish the runs. Return 0 if that is done, else 1."""
    try:
        refuse_writable_code()
        set_environment(SETTINGS_FILE)
        with host_errors():
            found = tuple(host for host, run in unfinished_hosts_here() if run.started.rarms == __version__)
        for host in found:
            report = finish_runs([host])
            if report is not None and report.ending is not RunEnding.DONE:
                return _failed(report.findings)
    except UseCaseError as error:
        return _failed(tuple(error.findings))
    except (RequestError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


def _failed(findings: tuple[Diagnostic, ...]) -> int:
    for finding in findings:
        sys.stderr.write(f"{finding.code}: {finding.detail}\n")
    return 1


if __name__ == "__main__":
    sys.exit(main())
