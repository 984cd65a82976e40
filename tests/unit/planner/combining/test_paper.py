"""TPTULR and CombineComponents, step by step as the paper has them, against an oracle that plays a script."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from rarms_iac.planner.combining.oracle import Coi, Members, total
from rarms_iac.planner.combining.paper import SUCCESSFUL, UNABLE, Inquiry, tune_performance_to_use_less_resource


@dataclass
class Scripted:
    """Each member of a compound needs a CR of its own there; asked settings are written down."""

    needs: Mapping[Members, Mapping[str, int]]
    asked: list[tuple[str, int]] = field(default_factory=list)

    def worse(self, members: Members, reserve: int) -> frozenset[str]:
        self.asked.append(("+".join(members), reserve))
        return frozenset(name for name, least in self.needs[members].items() if reserve < least)

    def unresolved(self, members: Members, reserve: int) -> bool:
        return False


@dataclass
class Answers:
    """Consents as told, and writes down what it was asked."""

    no: frozenset[Members] = frozenset()
    seen: list[tuple[Members, int, int]] = field(default_factory=list)

    def allows(self, members: Members, settings: int, gain: int) -> bool:
        self.seen.append((members, settings, gain))
        return members not in self.no


NEVER = 101


def within(capacity: int) -> Callable[[Sequence[Coi]], bool]:
    return lambda cois: total(cois) <= capacity


def coi(name: str, criticality: int, reserve: int, processors: int = 1) -> Coi:
    return Coi(name=name, members=(name,), criticality=criticality, processors=processors, reserve=reserve)


FOUR = (coi("vision", 40, 40), coi("speech", 30, 30), coi("paths", 20, 25), coi("video", 10, 15))


def test_nothing_is_asked_if_all_fits() -> None:
    oracle = Scripted({})
    done = tune_performance_to_use_less_resource(FOUR, within(110), Inquiry(oracle=oracle))

    assert (done.needed, done.message, oracle.asked) == (False, "", [])


def test_reservations_above_capacity_are_combined() -> None:
    oracle = Scripted({("paths", "video"): {"paths": 10, "video": 5}})
    done = tune_performance_to_use_less_resource(FOUR, within(109), Inquiry(oracle=oracle))

    assert done.message == SUCCESSFUL == "successful"
    assert oracle.asked == [("paths+video", 40), ("paths+video", 10)]


def test_the_papers_steps_in_the_papers_order() -> None:
    oracle = Scripted(
        {
            ("paths", "video"): {"paths": 60, "video": 50},  # both worse at the sum: TryAgain at once
            ("speech", "video"): {"speech": 30, "video": NEVER},  # one is worse: CMCPUR, which fails: TryAgain
            ("video", "vision"): {"vision": 45, "video": 20},
        }
    )
    done = tune_performance_to_use_less_resource(FOUR, within(100), Inquiry(oracle=oracle))

    assert oracle.asked == [
        ("paths+video", 40),
        ("speech+video", 45),
        *(("speech+video", reserve) for reserve in range(10, 101, 10)),
        ("video+vision", 55),
        *(("video+vision", reserve) for reserve in (10, 20, 30, 40, 50)),
    ]
    assert [("+".join(answer.components), answer.reserve) for answer in done.trail] == oracle.asked
    assert done.message == SUCCESSFUL
    (made,) = done.compounds
    assert (made.name, made.criticality, made.reserve) == ("vision", 40, 50)
    assert total(FOUR) - total(done.cois) == 5
    assert [coi.name for coi in done.cois] == ["vision", "speech", "paths"]


def test_worse_member_does_not_stop_the_pair() -> None:
    oracle = Scripted({("paths", "video"): {"paths": 45, "video": 15}})
    done = tune_performance_to_use_less_resource(FOUR, within(100), Inquiry(oracle=oracle))

    (made,) = done.compounds
    assert made.reserve == 50
    assert total(done.cois) - total(FOUR) == 10, "it ends above the sum"
    assert done.message == SUCCESSFUL


def test_where_nothing_can_be_combined_paper_says_so() -> None:
    pairs = [("speech", "video"), ("paths", "video"), ("video", "vision")]
    oracle = Scripted({pair: dict.fromkeys(pair, NEVER) for pair in pairs})
    done = tune_performance_to_use_less_resource(FOUR, within(100), Inquiry(oracle=oracle))

    assert oracle.asked == [("paths+video", 40), ("speech+video", 45), ("video+vision", 55)]
    assert done.message == UNABLE == "Unable to reduce total CPU reservation by combining CoIs"
    assert done.cois == FOUR


def test_repeating_continues_until_total_fits() -> None:
    oracle = Scripted(
        {
            ("paths", "video"): {"paths": 25, "video": 30},
            ("paths", "speech", "video"): {"speech": 30, "paths": 40, "video": 20},
        }
    )
    done = tune_performance_to_use_less_resource(FOUR, within(90), Inquiry(oracle=oracle), repeat=True)

    assert [(compound.name, compound.reserve) for compound in done.compounds] == [
        ("paths", 30),
        ("speech", 40),
    ]
    assert oracle.asked[4:6] == [("paths+speech+video", 60), ("paths+speech+video", 10)]
    assert [coi.cost for coi in done.cois] == [40, 40], "80 fits into 90: there it ends"


def test_compound_is_worse_if_a_member_is() -> None:
    compound = Coi(name="paths", members=("paths", "video"), criticality=20, processors=1, reserve=40)
    oracle = Scripted({("paths", "speech", "video"): {"speech": 80, "paths": 10, "video": 90}})
    done = tune_performance_to_use_less_resource((FOUR[1], compound), within(60), Inquiry(oracle=oracle))

    assert oracle.asked == [("paths+speech+video", 70)]
    assert done.message == UNABLE


def test_equal_criticalities_go_by_name() -> None:
    same = tuple(coi(name, 10, 40) for name in ("c", "a", "b"))
    oracle = Scripted({("b", "c"): {"b": 10, "c": 10}})
    done = tune_performance_to_use_less_resource(same, within(100), Inquiry(oracle=oracle))

    assert oracle.asked[0] == ("b+c", 80)
    assert done.compounds[0].name == "b"


def test_sum_beyond_the_host_is_asked_at_maximum() -> None:
    oracle = Scripted({("a", "b"): {"a": 70, "b": 70}})
    done = tune_performance_to_use_less_resource(
        (coi("a", 2, 70), coi("b", 1, 60)), within(100), Inquiry(oracle=oracle)
    )

    assert oracle.asked[:2] == [("a+b", 100), ("a+b", 10)]
    assert done.cois[0].reserve == 70


def test_sum_is_processor_time_across_sizes() -> None:
    wide, narrow = coi("a", 2, 30, processors=2), coi("b", 1, 55, processors=1)
    oracle = Scripted({("a", "b"): {"a": 40, "b": 40}})
    done = tune_performance_to_use_less_resource((wide, narrow), within(100), Inquiry(oracle=oracle))

    assert oracle.asked[0] == ("a+b", 58), "115 % of one processor, on two, rounded up"
    assert total((wide, narrow)) - total(done.cois) == 35


def test_apart_or_declined_is_not_measured() -> None:
    consent = Answers(no=frozenset({("speech", "video")}))
    oracle = Scripted({("video", "vision"): {"vision": 10, "video": 10}})
    inquiry = Inquiry(oracle=oracle, consent=consent, may_share=lambda members: "paths" not in members)
    tune_performance_to_use_less_resource(FOUR, within(100), inquiry)

    assert oracle.asked == [("video+vision", 55), ("video+vision", 10)]
    assert consent.seen == [(("speech", "video"), 11, 15), (("video", "vision"), 11, 15)]


def test_who_is_alone_cannot_be_combined() -> None:
    done = tune_performance_to_use_less_resource((coi("a", 1, 90),), within(80), Inquiry(oracle=Scripted({})))

    assert done.message == UNABLE
