"""`python -m dldsim`."""

import sys

try:
    from dldsim.app.cli import main

    code = main()
except KeyboardInterrupt:  # before the command began, or after its end
    sys.stderr.write("\ndldsim: interrupted.\n")
    code = 130
sys.exit(code)
