"""All that the doctor finds on a host."""

from collections.abc import Iterator

from rarms_iac.apply.doctor.checks import CHECKS
from rarms_iac.apply.doctor.examination import Examination
from rarms_iac.diff.comparing.partitions import foreign_marks
from rarms_iac.model.diagnostics import Diagnostic, in_order


def examine(host: Examination) -> tuple[Diagnostic, ...]:
    """Everything that makes a plan void or unsafe there, in order."""

    def told() -> Iterator[Diagnostic]:
        for check in CHECKS:
            yield from check.check(host)
        yield from foreign_marks(host.state)
        yield from host.told

    return in_order(tuple(told()))
