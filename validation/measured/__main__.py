"""`python -m validation.measured`: see blade_runs.py. A process that runs a row imports that, not this."""

import sys

from .blade_runs import main

if __name__ == "__main__":
    sys.exit(main())
