"""`python -m pmcl_ros.cli`."""

import sys

from pmcl_ros.cli import main

sys.exit(main())
