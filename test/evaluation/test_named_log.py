"""Messages of many captures say which one they are of."""

import logging

import pytest

from pmcl_ros.evaluation.named_log import log_named

LOG = logging.getLogger('pmcl_ros.somewhere')


def test_messages_begin_with_the_name_until_the_work_ends(caplog):
    def work():
        LOG.warning('lost, %.1f px off: %s', 3, 'check %s')
        LOG.warning('100 % of it')
        raise ValueError('of the work')

    with pytest.raises(ValueError, match='of the work'), log_named('50 % off/000003'):
        work()
    LOG.warning('done')
    assert caplog.messages == ['50 % off/000003: lost, 3.0 px off: check %s',
                               '50 % off/000003: 100 % of it', 'done']
