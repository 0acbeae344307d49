"""Waiting for what another thread or process does in its own time."""

import time

PATIENCE = 60.0  # s: of a busy machine; only a failure takes that long


def eventually(condition):
    """Return once `condition` is true; fail where it never becomes so."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, f'not true within {PATIENCE:g} s'
        time.sleep(0.02)
