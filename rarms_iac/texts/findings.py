"""Kinds of findings: templates that facts fill, and the findings that several packages have."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from string import Formatter
from typing import Any, Self, TypeAlias

from rarms_iac.model.commands import Wording, prose
from rarms_iac.model.diagnostics import Diagnostic, Fact, Facts, Place, Related, Severity
from rarms_iac.texts.messages import counted, in_a_row, list_names, quoted
from rarms_iac.texts.quantities import (
    plain,
    show_bytes,
    show_duration,
    show_milliseconds,
    show_percent,
    show_processors,
    write_bytes,
)

Given: TypeAlias = Fact | Fraction
"""A fact as a caller has it: programs get an exact number as a whole or a floating one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """A kind of problem: its stable code and the summary of every case. Its page is `docs/findings/<code>.md`."""

    code: str
    severity: Severity
    summary: str

    @classmethod
    def error(cls, code: str, summary: str) -> Self:
        """Return a kind of problem that stops a command."""
        return cls(code=code, severity=Severity.ERROR, summary=summary)

    @classmethod
    def warning(cls, code: str, summary: str) -> Self:
        """Return a kind of problem that stops nothing and may be accepted."""
        return cls(code=code, severity=Severity.WARNING, summary=summary)

    @classmethod
    def note(cls, code: str, summary: str) -> Self:
        """Return a kind of fact that a user may want to know."""
        return cls(code=code, severity=Severity.NOTE, summary=summary)

    def at(
        self,
        place: Place | None,
        template: str,
        advice: Wording,
        *,
        address: str = "",
        related: tuple[Related, ...] = (),
        **facts: Given,
    ) -> "Diagnostic":
        """Return one case of this finding.

        Args:
            place: In a manifest; None if the finding is about a host, a file or a run.
            template: What is wrong and why, as whole sentences with the facts in braces: `{component} stopped after
                {timeout:ms}`. `UNITS` has the formats.
            advice: What to do, as whole sentences with the commands that they recommend.
            address: What it is about, as `policy.accept` names it.
            facts: Names and numbers for the template and for programs. A fact with an underscore in front is for the
                template alone.
        """
        detail, values = fill_template(template, facts)
        return Diagnostic(
            code=self.code,
            severity=self.severity,
            summary=self.summary,
            detail=detail,
            advice=prose(advice),
            place=place,
            address=address,
            related=related,
            values=values,
        )

    def of_host(
        self, host: str, template: str, advice: Wording, *, place: Place | None = None, **facts: Given
    ) -> "Diagnostic":
        """Return one case that is about a host: its address is `host/<name>`, and `host` is one of its facts."""
        return self.at(place, template, advice, address=f"host/{host}", related=(), host=host, **facts)


UNITS: Mapping[str, tuple[str, Callable[[Any], str]]] = {
    "": ("", lambda fact: list_names(fact) if isinstance(fact, tuple) else _text_of(fact)),
    "or": ("", lambda fact: in_a_row(fact, "or")),
    "all": ("", in_a_row),
    "each": ("", ", ".join),
    ";": ("", "; ".join),
    "quoted": ("", quoted),
    ",": ("", "{:,}".format),
    "ms": ("_ms", show_milliseconds),
    "duration": ("_ms", show_duration),
    "%": ("_percent", show_percent),
    "lp": ("_lp", show_processors),
    "bytes": ("_bytes", write_bytes),
    "memory": ("_bytes", show_bytes),
}
"""Formats of a template, by what stands behind the colon: what programs find behind the fact's name, and the
text. Another format is a noun to count: `{errors:error}` is `2 errors`."""


def fill_template(template: str, facts: Mapping[str, Given]) -> tuple[str, Facts]:
    """Return a sentence and the facts for programs: `{timeout:ms}` of 2000 gives `2 s` and `timeout_ms: 2000`."""
    pieces: list[str] = []
    names = {name: name for name in facts if not name.startswith("_")}
    for text, name, unit, _ in Formatter().parse(template):
        pieces.append(text)
        if name is not None:
            suffix, show = UNITS.get(unit or "") or ("", partial(counted, noun=unit or ""))
            pieces.append(show(facts[name]))
            if name in names and not name.endswith(suffix):
                names[name] = name + suffix
    return "".join(pieces), {names[name]: _json_value(facts[name]) for name in names}


def _text_of(fact: Given) -> str:
    return plain(fact) if isinstance(fact, Fraction) else str(fact)


def _json_value(fact: Given) -> Fact:
    if isinstance(fact, Fraction):
        return fact.numerator if fact.denominator == 1 else float(fact)
    return fact


MOST_OF_A_KIND = 1_000
"""Findings of one kind that are shown."""


def first_of_each_kind(diagnostics: "Sequence[Diagnostic]") -> "tuple[Diagnostic, ...]":
    """Return the first `MOST_OF_A_KIND` findings of each kind (code and summary), and one that says how many follow."""
    totals = Counter((diagnostic.code, diagnostic.summary) for diagnostic in diagnostics)
    if all(total <= MOST_OF_A_KIND + 1 for total in totals.values()):
        return tuple(diagnostics)
    shown: list[Diagnostic] = []
    numbers = Counter[tuple[str, str]]()
    for diagnostic in diagnostics:
        kind = diagnostic.code, diagnostic.summary
        numbers[kind] += 1
        if numbers[kind] <= MOST_OF_A_KIND:
            shown.append(diagnostic)
        elif numbers[kind] == totals[kind]:
            shown.append(remainder(diagnostic, totals[kind] - MOST_OF_A_KIND))
    return tuple(shown)


def remainder(shown: Diagnostic, number: int) -> Diagnostic:
    """Return the finding, without a place and an address, that says how many follow of the kind of `shown`."""
    return replace(
        shown,
        detail=f"{number:,} more of this kind follow.",
        advice=prose("Correct the findings above."),
        values={"more": number},
        place=None,
        address="",
        related=(),
    )


CANNOT_RUN = Finding.error("RARMS285", "A component or a load cannot be run")
CLASS_ORDER = Finding.warning("RARMS128", "Priorities do not follow the criticalities")
DAMAGED = Finding.error("RARMS190", "The journal or a record on the host is damaged")
DIFFERENT = Finding.warning("RARMS105", "A data log was measured under other conditions")
FOREIGN_AT_NAME = Finding.error("RARMS150", "The name is already in use outside rarms")
GENERATION = Finding.error("RARMS256", "The machine's generation does not support this")
MAY_NOT_CHANGE = Finding.error("RARMS152", "A partition or machine must not be changed")
MISSING = Finding.error("RARMS016", "A required file or program is missing")
NEIGHBOURS = Finding.note("RARMS129", "Other threads may run before a robotic thread")
NOTHING_CHANGED = Finding.note("RARMS174", "Nothing was changed")
NOT_DONE = Finding.error("RARMS179", "The command cannot run with these arguments")
NOT_READ = Finding.error("RARMS001", "A file cannot be read")
NOT_YAML = Finding.error("RARMS007", "The YAML text cannot be read")
NO_EFFECT = Finding.warning("RARMS084", "A setting has no effect")
NO_ORDER = Finding.error("RARMS154", "No order of steps stays within the host's capacity")
NO_RESPONSIVENESS = Finding.error("RARMS227", "SystemResponsiveness cannot be set")
NO_TARGET = Finding.error("RARMS194", "The command cannot run on this target")
OTHER_VERSION = Finding.error("RARMS410", "The required version of rarms is missing")
OVER_HOST = Finding.error("RARMS061", "A reservation is larger than the host")
ROUNDED = Finding.warning("RARMS367", "A reserve is rounded up")
SCRIPT_REFUSED = Finding.error("RARMS251", "A script cannot be written or run")
UNKNOWN_KEY = Finding.error("RARMS015", "A key is not allowed here")
UNKNOWN_NAME = Finding.error("RARMS042", "Unknown name")
UNUSABLE_RESERVE = Finding.error("RARMS060", "A reserve or processor count is too large")
WRONG_VALUE = Finding.error("RARMS017", "A value is not allowed here")
