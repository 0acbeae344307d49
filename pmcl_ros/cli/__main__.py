"""`python -m pmcl_ros.cli`."""

import sys

from pmcl_ros.cli import main

if __name__ == '__main__':
    sys.exit(main())
