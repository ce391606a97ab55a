"""`python -m dldsim`."""

import sys

from dldsim.app.cli import main

sys.exit(main())
