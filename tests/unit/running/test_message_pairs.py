"""Which messages of an output belong to which of an input."""

from rarms_iac.running.message_pairs import MessageJob, MessagePairs


def begun() -> MessagePairs:
    """Pairs whose first job took 0.1 s, and is told."""
    pairs = MessagePairs(timeout_s=1.0)
    pairs.take_input(1, 0.0)
    pairs.take_output(1, 0.1)
    assert list(pairs.jobs(0.2)) == [MessageJob(began=0.0, ended=0.1)]
    return pairs


def test_first_of_several_outputs_counts() -> None:
    pairs = begun()
    pairs.take_input(2, 1.0)
    pairs.take_output(2, 1.2)
    pairs.take_output(2, 1.3)

    assert list(pairs.jobs(1.4)) == [MessageJob(began=1.0, ended=1.2)]
    pairs.take_output(2, 1.5)
    assert list(pairs.jobs(9.0)) == []
    assert pairs.unmatched == 0


def test_jobs_come_in_order_of_inputs() -> None:
    pairs = begun()
    for stamp in (2, 3, 4):
        pairs.take_input(stamp, 1.0 + stamp / 10)
    pairs.take_output(3, 1.5)

    assert list(pairs.jobs(1.6)) == []
    assert list(pairs.jobs(2.3)) == [MessageJob(began=1.2), MessageJob(began=1.3, ended=1.5)]
    assert list(pairs.jobs(2.5)) == [MessageJob(began=1.4)]


def test_a_late_output_is_no_answer() -> None:
    pairs = begun()
    pairs.take_input(2, 1.0)
    pairs.take_output(2, 2.5)

    assert list(pairs.jobs(2.6)) == [MessageJob(began=1.0)]


def test_nothing_counts_before_the_first_answer() -> None:
    pairs = MessagePairs(timeout_s=1.0)
    for stamp in (1, 2, 3):
        pairs.take_input(stamp, float(stamp))
    assert list(pairs.jobs(2.5)) == []

    pairs.take_output(3, 3.1)

    assert list(pairs.jobs(9.0)) == [MessageJob(began=3.0, ended=3.1)]


def test_output_may_come_before_its_input() -> None:
    pairs = begun()
    pairs.take_output(2, 1.0)
    pairs.take_input(2, 1.1)

    assert list(pairs.jobs(1.2)) == [MessageJob(began=1.1, ended=1.1)]


def test_stamps_may_come_again() -> None:
    pairs = begun()
    pairs.take_input(1, 5.0)
    pairs.take_output(1, 5.2)

    assert list(pairs.jobs(5.3)) == [MessageJob(began=5.0, ended=5.2)]


def test_foreign_stamps_are_counted() -> None:
    pairs = begun()
    pairs.take_output(99, 1.0)
    pairs.take_output(0, 1.0)

    assert list(pairs.jobs(3.0)) == []
    assert (pairs.unmatched, pairs.unstamped_inputs, pairs.unstamped_outputs) == (1, 0, 1)
