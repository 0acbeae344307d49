"""Times the stages against their plain forms, run beside them in the same process."""
