"""Findings on the messages of ROS that samples come from: clocks that are not this machine's."""

from collections.abc import Iterator, Sequence

from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.setting import SettingEvidence, join_heard
from rarms_iac.texts.findings import Finding
from rarms_iac.texts.quantities import show_duration

OTHER_CLOCK = Finding.warning("RARMS430", "Message stamps are from another clock")
SIMULATED_TIME = Finding.warning("RARMS431", "The robot runs on simulated time")

MOST_AHEAD_MS = 5.0
"""No message comes before its stamp; adjusting a clock moves it by less."""
MOST_BEHIND_MS = 10_000.0
"""So old are no data that a robot still acts on."""


def messages_of_evidence(evidence: Sequence[SettingEvidence], places: Places) -> Iterator[Diagnostic]:
    """Find stamps of another clock, and simulated time.

    Args:
        evidence: Of each setting or start.
    """
    for component, heard in sorted(join_heard(evidence).items()):
        place = places.key("components", component, "run", "samples")
        if heard.simulated_time:
            yield SIMULATED_TIME.at(
                place,
                "{component}: use_sim_time is set, but rarms measures response times with the clock of this machine.",
                "Play bags at their recorded rate. Set use_sim_time to false to measure with the robot's sensors.",
                address=f"component/{component}",
                component=component,
            )
        elif heard.inputs and not -MOST_BEHIND_MS <= heard.ahead_ms <= MOST_AHEAD_MS:
            yield OTHER_CLOCK.at(
                place,
                (
                    "{component}: the stamps of {input} are {_away} {_side} the clock of this machine. rarms "
                    "therefore counts response times from the arrival of {input} here."
                ),
                "If another machine publishes {input}, synchronize the clocks. A bag file has old stamps.",
                address=f"component/{component}",
                component=component,
                input=heard.input,
                ahead_ms=heard.ahead_ms,
                _away=show_duration(abs(heard.ahead_ms)),
                _side="ahead of" if heard.ahead_ms > 0 else "behind",
            )
