"""``python -m kiribench``."""

import sys

from kiribench.cli import main

if __name__ == "__main__":
    sys.exit(main())
