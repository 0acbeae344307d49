"""Messages of about one stamp are joined, the oldest first."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pmcl_ros.nodes.transport.approximate_synchronizer import ApproximateSynchronizer

TOPICS = ['a', 'b', 'c']


def make(*messages, slop=10):
    """One that has got messages (topic, stamp); each is its own stamp."""
    matching = ApproximateSynchronizer(TOPICS, slop)
    for topic, stamp in messages:
        matching.add(topic, stamp, stamp)
    return matching


def test_a_set_has_the_order_of_the_topics_and_stays_until_it_is_popped():
    matching = make(('c', 110), ('a', 100), ('b', 105))
    for _ in range(2):
        assert list(matching.oldest().items()) == [('a', 100), ('b', 105), ('c', 110)]
    assert matching.decided
    matching.pop()
    assert matching.oldest() == {}
    assert matching.longest == 0
    assert not matching.decided


def test_what_is_too_far_apart_is_of_two_sets():
    matching = make(('a', 100), ('b', 111), ('c', 105))
    assert matching.oldest() == {'a': 100, 'c': 105}
    assert matching.decided  # b has gone on
    matching.pop()
    assert matching.oldest() == {'b': 111}
    assert not matching.decided  # what a and c have of it may still come


def test_a_topic_that_begins_anew_forgets_what_was_later():
    matching = make(('a', 500), ('a', 600), ('b', 600), ('a', 100))
    assert matching.longest == 1
    assert matching.oldest() == {'a': 100}


@given(st.data())
def test_sets_are_found_however_messages_are_delayed(data):
    """Of each topic in order, but one topic before or after another."""
    count = 6
    jitter = data.draw(st.lists(st.integers(0, 10), min_size=3 * count, max_size=3 * count))
    stamps = 100 * np.arange(count) + np.reshape(jitter, (3, count))
    lost = data.draw(st.sets(st.tuples(st.integers(0, 2), st.integers(0, count - 1)), max_size=4))
    of = [topic for topic in range(3) for number in range(count) if (topic, number) not in lost]
    order = data.draw(st.permutations(of))
    queues = [iter([int(stamps[topic, number]) for number in range(count)
                    if (topic, number) not in lost]) for topic in range(3)]
    matching, found = make(), []
    for topic in order:
        stamp = next(queues[topic])
        matching.add(TOPICS[topic], stamp, stamp)
        while matching.decided:
            each = matching.oldest()
            if len(each) == 3:
                found.append([*each.values()])
            matching.pop()
    assert found == [stamps[:, number].tolist() for number in range(count)
                     if not {(topic, number) for topic in range(3)} & lost]
