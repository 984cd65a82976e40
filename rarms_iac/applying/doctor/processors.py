"""Logical processors that are not alike: found by the doctor and by plans."""

from collections.abc import Iterator

from rarms_iac.applying.doctor.examination import Examination
from rarms_iac.model.diagnostics import Diagnostic, Finding
from rarms_iac.model.state import ProcessorKind
from rarms_iac.model.wording import counted, in_a_row

UNEQUAL = Finding.warning("RARMS405", "The logical processors of a host are unequal")


def check_unequal_processors(host: Examination) -> Iterator[Diagnostic]:
    """Yield a partition may run on any of them, and a component takes longer on the slower ones."""
    kinds = host.state.facts.processor_kinds
    if kinds:
        yield host.host_finding(
            UNEQUAL,
            f"The logical processors of {host.name} are of {len(kinds)} kinds: {in_a_row(list(map(_words, kinds)))}. "
            "A measurement on one kind does not hold on the other.",
            "Turn SMT off, or turn off the processors of one kind in the firmware or the operating system; then "
            "measure again. Otherwise raise the reserves until `rarms prove` passes.",
            {"processors": tuple(str(kind.processors) for kind in kinds)},
        )


def _words(kind: ProcessorKind) -> str:
    facts = (
        (kind.threads, f"in cores with {counted(kind.threads, 'thread')}"),
        (kind.capacity, f"of capacity {kind.capacity}"),
        (kind.base_mhz, f"with a base frequency of {kind.base_mhz} MHz"),
    )
    return " ".join([str(kind.processors), *(words for known, words in facts if known)])
