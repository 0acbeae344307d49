"""Messages are joined by stamp, and what is given up is told."""

from pmcl_ros.nodes.transport.exact_synchronizer import ExactSynchronizer


def make(depth=2):
    told = []
    return ExactSynchronizer(['a', 'b', 'c'], depth, told.append), told


def test_a_capture_is_complete_in_whatever_order_it_comes():
    matching, told = make()
    assert matching.add('c', 1, 'c1') is None
    assert matching.add('a', 1, 'a1') is None
    assert matching.add('b', 1, 'b1') == ('a1', 'b1', 'c1')
    assert told == []


def test_a_capture_is_given_once():
    matching, _ = make()
    for each in 'ab':
        matching.add(each, 1, each)
    assert matching.add('c', 1, 'c') == ('a', 'b', 'c')
    assert matching.add('c', 1, 'again') is None


def test_captures_do_not_mix():
    matching, told = make()
    for each in 'ab':
        matching.add(each, 1, f'{each}1')
        matching.add(each, 2, f'{each}2')
    assert matching.add('c', 1, 'c1') == ('a1', 'b1', 'c1')
    assert matching.add('c', 2, 'c2') == ('a2', 'b2', 'c2')
    assert told == []


def test_what_began_before_a_complete_capture_is_given_up():
    matching, told = make()
    matching.add('a', 1, 'a1')
    for each in 'ab':
        matching.add(each, 2, each)
    assert matching.add('c', 2, 'c')
    assert told == ['capture 1: no b or c came with it']


def test_no_more_than_depth_are_kept():
    matching, told = make()
    for stamp in range(5):
        matching.add('a', stamp, 'a')
    assert told == [f'capture {stamp}: no b or c came with it' for stamp in range(3)]


def test_stamps_may_go_back_as_in_a_bag_played_again():
    matching, _ = make()
    for _ in range(2):
        for stamp in (5, 3):
            matching.add('a', stamp, 'a')
            matching.add('b', stamp, 'b')
            assert matching.add('c', stamp, 'c') == ('a', 'b', 'c')


def test_what_still_comes_of_a_capture_that_was_given_up_is_left_alone():
    matching, told = make(depth=1)
    for topic, stamp in (('a', 1), ('a', 2), ('b', 1), ('c', 1), ('b', 2)):
        assert matching.add(topic, stamp, topic) is None
    assert told == ['capture 1: no b or c came with it']
    assert matching.add('c', 2, 'c') == ('a', 'b', 'c')
    # But what has come late, too, may come again.
    assert matching.add('b', 1, 'b') is matching.add('a', 1, 'a') is None
    assert matching.add('c', 1, 'c') == ('a', 'b', 'c')


def test_a_capture_that_was_given_up_may_come_again():
    matching, told = make(depth=1)
    for topic, stamp in (('a', 1), ('a', 2), ('a', 1), ('b', 1)):
        assert matching.add(topic, stamp, topic) is None
    assert matching.add('c', 1, 'c') == ('a', 'b', 'c')
    assert told == ['capture 1: no b or c came with it', 'capture 2: no b or c came with it']
