"""What makes every plan for the host void: plans tell of it too."""

from collections.abc import Iterator

from rarms_iac.apply.doctor.examination import Examination
from rarms_iac.apply.void import no_rights, void_scheduler
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.state import Rights
from rarms_iac.model.system import ProviderKind


def check(host: Examination) -> Iterator[Diagnostic]:
    """Tells of rights that are not proven, and of a scheduler that ignores reserves or is not known.

    Linux schedules control groups itself; whether they may be made is asked where they are made.
    """
    facts = host.state.facts
    if facts.provider is ProviderKind.LINUX:
        return
    if facts.rights is not Rights.PROVEN:
        yield no_rights(facts, host.place)
    yield from void_scheduler(facts, "its machines", host.place)
