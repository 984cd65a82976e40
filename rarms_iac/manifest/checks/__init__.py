"""Everything that can be judged from the manifest alone: one module a topic, one function a check.

A checked `System` comes in, ordered findings go out. `check(finding)` above a function makes it one of `CHECKS`; it
yields a `Violation` for each case, and `run_checks` makes findings with places of them. Begin with `violation` and any
topic: `names`, `partitions`, `hosts`, `processors`, `measurement`.
"""

from collections.abc import Iterator
from datetime import date
from itertools import chain, islice

from rarms_iac.manifest.acceptance import FINDINGS as ABOUT_ACCEPTANCES
from rarms_iac.manifest.acceptance import check_acceptances
from rarms_iac.manifest.checks import hosts, measurement, names, partitions, processors  # noqa: F401 - each adds its checks
from rarms_iac.manifest.checks.violation import CHECKS
from rarms_iac.manifest.overlays import UNKNOWN_NAME
from rarms_iac.model.diagnostics import Diagnostic, Places, in_order
from rarms_iac.model.system import System
from rarms_iac.texts.findings import MOST_OF_A_KIND, remainder

CODES = frozenset(finding.code for finding in (*(finding for finding, _ in CHECKS), *ABOUT_ACCEPTANCES, UNKNOWN_NAME))
"""The codes of findings about a manifest and its overlays: another command may need an acceptance of another code."""


def run_checks(system: System, places: Places, today: date) -> tuple[Diagnostic, ...]:
    """Report everything that is wrong or odd about what the manifest means, in order.

    Args:
        today: the day in UTC that acceptances expire against.

    Returns:
        Of a kind that the policy accepts somewhere all of them, of another the first `MOST_OF_A_KIND` and how many
        follow: places are looked up for those that can be shown, not for every one of 390,000.
    """

    def findings() -> Iterator[Diagnostic]:
        for finding in dict.fromkeys(finding for finding, _ in CHECKS):
            violations = chain.from_iterable(check(system) for kind, check in CHECKS if kind is finding)
            most = None if finding.code in system.policy.accept else MOST_OF_A_KIND
            shown = [violation(finding, places) for violation in islice(violations, most)]
            yield from shown
            if more := sum(1 for _ in violations):
                yield remainder(shown[-1], more)
        yield from check_acceptances(system.policy, places, today)

    return in_order(tuple(findings()))
