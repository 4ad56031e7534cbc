"""`python -m validation.measured`: see runs.py. A process that runs a row imports that, not this."""

import sys

from .runs import main

if __name__ == "__main__":
    sys.exit(main())
