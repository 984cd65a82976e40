"""The sentences of the report: each platform's total against its capacity, what tuning came to, what is applied."""

from fractions import Fraction

from rarms_iac.app.drift import ComparedHost
from rarms_iac.app.report_model import PlatformCapacity, PlatformTuning
from rarms_iac.diff.drift import DriftKind
from rarms_iac.model.commands import APPLY, PLAN, Wording, prose
from rarms_iac.model.quantities import share_of_host, show_lp_percent, show_processors
from rarms_iac.views.drift import TITLES
from rarms_iac.views.status import describe_other_claims
from rarms_iac.views.tune import describe_proof
from rarms_iac.views.verdicts import why_not_known


def fit_text(fit: PlatformCapacity) -> str:
    """As `1.4 LP of 2 LP reserved (70 % of onboard). Headroom of onboard: 0.6 LP (30 % of onboard).`.

    What is kept for the hosts and what unmanaged machines have is named where there is some.

    While the reservation of a component is not known, the total begins with "at least" and no headroom is said.
    """
    unpromised, hosts = fit.unpromised_lp, ", ".join(fit.hosts)

    def amount(processors: Fraction) -> str:
        return f"{show_processors(processors)} ({share_of_host(processors, fit.processors, hosts)})"

    least = "at least " if fit.unknown else ""
    room = (
        f"Headroom of {hosts}: {amount(unpromised)}"
        if unpromised >= 0
        else f"Over {hosts} by {least}{amount(-unpromised)}"
    )
    if fit.unknown:
        room = f"Headroom of {hosts}: not known: {why_not_known(fit.unknown)}" if unpromised >= 0 else room
    share = share_of_host(fit.reserved_lp, fit.processors, hosts)
    reserved = f"{least}{show_processors(fit.reserved_lp)} of {show_processors(fit.processors)} reserved"
    return f"{reserved[:1].upper()}{reserved[1:]} ({share}){other_claims_text(fit)}. {room}."


def other_claims_text(fit: PlatformCapacity) -> str:
    """`, 0.2 LP kept for the host`: what is neither reserved by the application nor headroom."""
    return "".join(f", {text}" for text in describe_other_claims(fit.unmanaged_lp, fit.kept_lp))


def tuning_text(tuning: PlatformTuning) -> str:
    """Return what came of it, and whether it is the best there is."""
    run = tuning.run
    before, after, capacity = (show_lp_percent(amount) for amount in (run.before, run.after, run.capacity))
    result = f"{before} became {after}" if run.before != run.after else before
    result += f", the capacity is {capacity}"
    proof = "".join(f" {sentence}" for sentence in describe_proof(run))
    broken = f" Nothing is proved: {'; '.join(run.contradictions)}." if run.contradictions else ""
    written = "" if run.written or run.ending != "successful" else " The manifest was left as it is."
    ending = (run.message or run.ending.replace("_", " ")).capitalize()
    outdated = "".join(f" {'+'.join(names)} is outdated: {why}." for names, why in tuning.outdated.items())
    return f"{ending}: {result} ({run.strategy} strategy, {run.when}).{proof}{broken}{written}{outdated}"


def applied_text(host: ComparedHost, *, is_planned: bool) -> Wording:
    """Whether what the manifest asks for is on the host, and what brings it there."""
    if not is_planned:
        return prose("Nothing can be applied as it is: ", PLAN, " tells why.")
    if not host.to_apply:
        return "Applied: the host is as the manifest wants it."
    addresses_of: dict[str, list[str]] = {}
    for difference in host.to_apply:
        title = TITLES[DriftKind.NOT_APPLIED if difference.drift is DriftKind.MISSING else difference.drift]
        addresses_of.setdefault(title, []).append(str(difference.address))
    parts = "; ".join(f"{message}: {', '.join(addresses)}" for message, addresses in addresses_of.items())
    return prose(f"{parts[:1].upper()}{parts[1:]}. ", PLAN, " shows what is to be done, ", APPLY, " does it.")
