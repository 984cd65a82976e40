from fractions import Fraction

from rarms_iac.model.diagnostics import Finding

LATE = Finding.error("RARMS999", "Too late")


def test_one_set_of_facts_gives_sentence_and_values() -> None:
    found = LATE.at(
        None,
        "{component} stopped after {timeout:ms} with {errors:error}: {loads} and {share:%} of {memory:bytes}{_end}",
        "Wait.",
        component="vision",
        timeout=2000,
        errors=2,
        loads=("a", "b"),
        share=Fraction(1, 2),
        memory=2**29,
        rest_ms=1,
        _end=".",
    )

    assert found.detail == "vision stopped after 2 s with 2 errors: a and b and 0.5 % of 512 MiB."
    assert found.values == {
        "component": "vision",
        "timeout_ms": 2000,
        "errors": 2,
        "loads": ("a", "b"),
        "share_percent": 0.5,
        "memory_bytes": 2**29,
        "rest_ms": 1,
    }


def test_braces_of_a_fact_stay() -> None:
    assert LATE.of_host("{0}", "{host} has {reason}.", "Wait.", reason="{x}").detail == "{0} has {x}."
