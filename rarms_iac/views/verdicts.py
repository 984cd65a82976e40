"""The verdict on components in words, for all views."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

from rarms_iac.app.report_model import ComponentVerdict
from rarms_iac.model.commands import MEASURE, Prose, prose
from rarms_iac.model.indexes import PerformanceIndex, show_bound
from rarms_iac.model.outcomes import Achievement
from rarms_iac.model.system import Threshold
from rarms_iac.model.wording import in_a_row, list_names


def describe_achievement(achievement: Achievement, not_measured: tuple[str, ...]) -> str:
    """Describe the verdict on a threshold or a component: `met`, `not measured with bursts-20`."""
    suffix = f" with {in_a_row(not_measured)}" if achievement is Achievement.UNMEASURED and not_measured else ""
    return f"{achievement}{suffix}"


def describe_verdicts(verdicts: Iterable[ComponentVerdict]) -> Iterator[str]:
    """Name the components of each verdict, worst first: `Not shown yet: vision (p95_response_time) and speech`."""
    for words, names in _by_words(verdicts, with_indexes=True).items():
        yield f"{words[:1].upper()}{words[1:]}: {in_a_row(names)}"


def _by_words(verdicts: Iterable[ComponentVerdict], *, with_indexes: bool) -> Mapping[str, Sequence[str]]:
    named: dict[str, dict[str, None]] = {}
    for verdict in sorted(verdicts, key=lambda each: tuple(Achievement).index(each.achievement), reverse=True):
        indexes = f" ({in_a_row(verdict.indexes)})" if with_indexes and verdict.achievement in _OF_INDEXES else ""
        words = describe_achievement(verdict.achievement, verdict.not_measured)
        named.setdefault(words, {})[f"{verdict.component}{indexes}"] = None
    return {words: tuple(names) for words, names in named.items()}


_OF_INDEXES = frozenset({Achievement.OPEN, Achievement.MISSED})


def describe_verdicts_of(verdicts: Iterable[ComponentVerdict], component: str) -> Iterator[str]:
    """Describe the verdict on a component, one for each platform: `not shown yet: p95_response_time`."""
    own = [verdict for verdict in verdicts if verdict.component == component]
    for verdict in own:
        suffix = f" on {verdict.platform}" if len(own) > 1 else ""
        indexes = f": {in_a_row(verdict.indexes)}" if verdict.achievement in _OF_INDEXES else ""
        yield f"{describe_achievement(verdict.achievement, verdict.not_measured)}{suffix}{indexes}"


def advise_to_measure(verdicts: Iterable[ComponentVerdict]) -> Prose | None:
    """Recommend the command that measures the rest; None: everything is measured."""
    if all(verdict.achievement is not Achievement.UNMEASURED for verdict in verdicts):
        return None
    return prose("Measure what is missing: ", MEASURE, ".")


def why_not_known(verdicts: Iterable[ComponentVerdict]) -> str:
    """Explain why a total is not known, worst first: `vision and speech are not shown yet; drive is not measured`."""
    return "; ".join(
        f"{list_names(names)} {'is' if len(names) == 1 else 'are'} {words}"
        for words, names in _by_words(verdicts, with_indexes=False).items()
    )


def short_bound(index: PerformanceIndex, threshold: Threshold) -> str:
    """`p95 <= 100 ms`, `success_rate >= 99 %`: what leaves room in a table."""
    return f"{index.name.removesuffix('_response_time')} {show_bound(index, threshold)}"
