"""`python -m pmcl_ros.cli`."""

import sys

from pmcl_ros.runtime.start import start

if __name__ == '__main__':
    sys.exit(start('pmcl'))
