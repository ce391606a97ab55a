"""`python -m dldsim`."""

import sys

from dldsim.cli import main

sys.exit(main())
