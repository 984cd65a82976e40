"""How a run ended, host by host."""

from collections.abc import Iterator

from rarms_iac.apply.refusals import UNDO_PARTIAL
from rarms_iac.apply.run_report import Ending, HostReport, RunReport
from rarms_iac.model.journal import RunKind
from rarms_iac.views.as_json import as_json
from rarms_iac.views.diagnostics.layout import wrap
from rarms_iac.views.diagnostics.text import counted
from rarms_iac.views.output.runs import HostRunOutput, RunOutput
from rarms_iac.views.plan import count

GO_ON = "Run `rarms apply` to finish it, `rarms undo` to take it back, or `rarms apply --abandon` to leave it as it is."


def run_text(report: RunReport, *, width: int) -> str:
    """A sentence a host, and what to do next where it is not done; findings are told elsewhere."""
    return "".join(f"{line}\n" for sentence in _sentences(report) for line in wrap(sentence, width, ""))


def _sentences(report: RunReport) -> Iterator[str]:
    for host in report.hosts:
        yield f"{host.host}: {_host(host, lasting=_lasting(report))}"
    match report.ending:
        case Ending.NOTHING:
            yield "Nothing to do."
        case Ending.INTERRUPTED:
            yield f"Stopped after the running step. {GO_ON}"
        case Ending.DONE | Ending.REFUSED | Ending.FAILED:
            pass


def _lasting(report: RunReport) -> bool:
    """Whether something of what an undo was to take back cannot be."""
    return any(diagnostic.code == UNDO_PARTIAL.code for diagnostic in report.diagnostics)


def _host(report: HostReport, *, lasting: bool) -> str:
    what = "Apply" if report.run is RunKind.APPLY else "Undo"
    begun = f"{what} of plan {report.plan}{', begun earlier,' if report.resumed else ''}"
    if report.run is RunKind.UNDO and report.ending is Ending.DONE and not report.total:
        return f"{begun}: nothing of it can be taken back." if lasting else f"{begun}: it had changed nothing."
    steps = f"{counted(report.changed, 'step')} changed something, {report.unchanged} found all as wanted"
    if report.ending is not Ending.DONE:
        left = report.total - report.changed - report.unchanged
        return f"{begun} not complete: {steps}, {left} of {report.total} left."
    if report.changes:
        steps = f"{_resources(report)} ({counted(report.total, 'step')}; {report.unchanged} found all as wanted)"
    return f"{begun} complete: {steps}."


def _resources(report: HostReport) -> str:
    counts = count(iter(report.changes))
    told = [f"{counts['add']} added", f"{counts['change']} changed", f"{counts['remove']} removed"]
    told += [f"{counts[name]} {says}" for name, says in (("adopt", "adopted"), ("release", "released")) if counts[name]]
    return ", ".join(told)


def run_json(report: RunReport) -> str:
    """The same for programs."""
    return as_json(
        RunOutput(
            ending=report.ending.value,
            hosts=tuple(
                HostRunOutput(
                    host=host.host,
                    plan=host.plan,
                    run=host.run.value,
                    ending=host.ending.value,
                    changed=host.changed,
                    unchanged=host.unchanged,
                    total=host.total,
                    resumed=host.resumed,
                )
                for host in report.hosts
            ),
            findings=report.diagnostics,
        )
    )
